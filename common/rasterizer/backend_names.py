"""What can stand behind the interface; `readygo.common.rasterizer.backends` makes them."""

from typing import Literal

Backend = Literal["cpu", "reference", "triton", "gsplat"]
GPU_BACKENDS = ("triton", "gsplat")
