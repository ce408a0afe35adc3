"""Other renderers that anyone can run, measured on the same images."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.render_run import Render, make_render
from benchmarks.render_setting import Setting

PEER_GAUSSIANS_MAX = 3_000_000
"""Slow peers take minutes and gigabytes beyond this."""


@dataclass(frozen=True, kw_only=True)
class PeerResult:
    """How a peer did; without a number, why."""

    images_per_s: float | None = None
    psnr_db: float | None = None
    """Of our image against the peer's."""
    why_none: str = ""


def _reference(setting: Setting, render: Render, gaussians: int) -> PeerResult:
    """The plain NumPy renderer, one image."""
    if gaussians > PEER_GAUSSIANS_MAX:
        return PeerResult(why_none=f"above {PEER_GAUSSIANS_MAX:,} Gaussians")
    peer = make_render(replace(setting, job=replace(setting.job, backend="reference", lod="off")))
    T, people = setting.view(setting.places[0], 0)
    begin_s = time.thread_time()
    image = peer(T, people)
    spent_s = time.thread_time() - begin_s
    error = image.astype(np.float64) - render(T, people)
    psnr_db = 10 * math.log10(255**2 / max(float((error**2).mean()), 1e-9))
    return PeerResult(images_per_s=1 / spent_s, psnr_db=psnr_db)


PEERS: dict[str, Callable[[Setting, Render, int], PeerResult]] = {"reference": _reference}
"""Name -> its measurement, given the setting, our renderer and the number of the scene's Gaussians."""
