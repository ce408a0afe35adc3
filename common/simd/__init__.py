"""Explicit SIMD types for numba (`types`), and their loads, stores and shuffles (`memory`)."""
