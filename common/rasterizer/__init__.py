"""Images of Gaussian clouds: the CPU rasterizer in `cpu`, the reference in `reference`, their rules in `constants`.

Import the modules themselves: the kernels take a second to load.
"""
