"""The rasterizer's own Triton kernels."""
