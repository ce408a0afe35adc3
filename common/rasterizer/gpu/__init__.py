"""Images of Gaussian clouds on a GPU: the interface in `rasterizer`, our Triton kernels or gsplat behind it.

Import the modules themselves: torch takes seconds to load, and Triton and gsplat need not be installed.
"""
