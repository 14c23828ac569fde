"""From LLVM IR to machine code in this process, called on arrays.

compile   IR to an object file, and that loaded
kernel    a program called on arrays, in lanes and threads; code from the cache where it is there
builtin   the same as a function of CPython's own kind
peak      what this CPU can do at most
"""
