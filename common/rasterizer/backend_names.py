"""What can stand behind the interface, and what some cannot make; `readygo.common.rasterizer.backends` makes them."""

from typing import Literal

Backend = Literal["cpu", "reference", "triton", "gsplat"]
GPU_BACKENDS = ("triton", "gsplat")
GSPLAT_OUTPUTS = frozenset({"rgb", "depth", "alpha", "normal"})
"""Images that the backend gsplat makes, of `readygo.common.images.images.OUTPUTS`: it keeps no median Gaussian."""
