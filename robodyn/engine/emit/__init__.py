"""From programs to LLVM IR.

types, code, value      how IR is written: types of scalars and lanes, the body of a function, values with operators
trigonometry, large_angles, elementary, library     functions of numbers, our own and C's
constants, rows         a function's table of numbers; rows of memory to lanes and back
straight, loops, parts  the functions of a program: straight-line code, loops over forests, either
blocks                  the loop over a batch
tableau, stepper, runge_kutta, header, vectors, integrate   integrators: data, the contract of a method, those of a tableau, the loop
call                    a call from CPython
"""
