"""How a question is answered: by the formalism itself on float64 or 50-digit numbers, or by a kernel traced from it.

asking                what Scene and Robot have in common: the questions' methods
evaluator             who answers
routes                which formalism, and what is compiled of it; `remembered`: what was found out before, kept on disk
tracing               a question to a program; `looped`: on a tree whose sweeps are recorded
integrator_programs   what native integrators call
base_parameters       whether base inertial parameters cost digits
laws                  whether users' laws still are what was compiled
composed              large robots with shared coordinates: kernels and LAPACK
shortcuts             built-in functions that answer plain calls
"""
