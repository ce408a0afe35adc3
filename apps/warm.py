"""`readygo warm`: compile the kernels once per machine, before workers need them."""

import time

from rich.console import Console


def warm() -> None:
    """Compile all numba kernels into the user's cache; later processes load them in under a second."""
    begin_s = time.monotonic()
    warm_all()
    Console(stderr=True).print(f"Kernels are compiled ({time.monotonic() - begin_s:.1f} s).")


def warm_all() -> None:
    """Compile what the stages use; one process compiles while others wait."""
    from common.rasterizer.warm import warm as warm_rasterizer

    warm_rasterizer()
