"""Explicit SIMD types for numba, and how kernels are compiled and cached."""
