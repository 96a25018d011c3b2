"""Pure compiled functions that truth and flight software share: vectors, attitude, gravity, orbits, random numbers.

Inside a kernel, small vectors and matrices are tuples: a kernel loads them once (`vectors.vec3`, `vectors.mat3`),
computes with tuples, and stores the result (`vectors.store3`). Tuples live in processor registers, so nothing is
allocated and nothing can be overwritten by accident. Large matrices are arrays, and functions on them write into an
argument named ``out``.
"""
