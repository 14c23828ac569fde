"""From programs to LLVM IR."""
