"""From LLVM IR to machine code in this process, called on arrays."""
