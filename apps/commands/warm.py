"""`readygo warm`: compiles the kernels once per machine, before workers need them."""

import time
from dataclasses import dataclass

from readygo.apps.terminal import PlainConsole
from readygo.runs.warm import warm_all, warm_states


@dataclass(frozen=True, kw_only=True)
class WarmOptions:
    """Compile the numba kernels into the user's cache; later processes load them in under a second."""

    states: bool = False
    """Compile those that only `readygo rl` and `learn` need as well."""


def warm(options: WarmOptions) -> None:
    """Compile the numba kernels into the user's cache; later processes load them in under a second."""
    begin_s = time.monotonic()
    warm_all()
    if options.states:
        warm_states()
    PlainConsole(stderr=True).print(f"Kernels are compiled ({time.monotonic() - begin_s:.1f} s).")
