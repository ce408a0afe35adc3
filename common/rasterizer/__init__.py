"""Images of Gaussian clouds: one interface in `interface`, made in `backends`; their rules in `constants`.

Import the modules themselves: the kernels take a second to load.
"""
