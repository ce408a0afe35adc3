"""The CPU rasterizer: numba kernels with explicit SIMD."""
