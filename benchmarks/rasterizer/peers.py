"""Other renderers that anyone can run, measured on the same images."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from readygo.benchmarks.rasterizer.runs import make_backend, make_gpu
from readygo.benchmarks.rasterizer.setting import Setting
from readygo.common.arrays import UInt8Array
from readygo.common.errors import ReadygoError
from readygo.common.rasterizer.interface import Rasterizer

PEER_GAUSSIANS_MAX = 3_000_000
"""Slow peers take minutes and gigabytes beyond this."""
GPU_IMAGES = 50


@dataclass(frozen=True, kw_only=True)
class PeerResult:
    """How a peer did; without a number, why."""

    images_per_s: float | None = None
    psnr_db: float | None = None
    """PSNR of our image against the peer's [dB]."""
    why_none: str = ""


def _reference(setting: Setting, rasterizer: Rasterizer, gaussians: int) -> PeerResult:
    """The plain NumPy renderer, one image."""
    if gaussians > PEER_GAUSSIANS_MAX:
        return PeerResult(why_none=f"above {PEER_GAUSSIANS_MAX:,} Gaussians")
    peer = make_backend(replace(setting, job=replace(setting.job, backend="reference", lod="off")))
    view = setting.view(setting.places[0], 0)
    begin_s = time.thread_time()
    image = peer.render([view]).rgb[0]
    spent_s = time.thread_time() - begin_s
    return PeerResult(images_per_s=1 / spent_s, psnr_db=_psnr_db(image, rasterizer.render([view]).rgb[0]))


def _gsplat(setting: Setting, rasterizer: Rasterizer, gaussians: int) -> PeerResult:
    """Gsplat on the GPU, one image per call."""
    try:
        peer = make_gpu(setting, "gsplat")
    except ReadygoError as error:
        return PeerResult(why_none=f"no gpu: {error}" if "CUDA" in str(error) else str(error))
    view = setting.view(setting.places[0], 0)
    image = peer.render([view]).rgb[0]
    begin_s = time.perf_counter()
    for _ in range(GPU_IMAGES):
        peer.render([view])
    spent_s = (time.perf_counter() - begin_s) / GPU_IMAGES
    return PeerResult(images_per_s=1 / spent_s, psnr_db=_psnr_db(image, rasterizer.render([view]).rgb[0]))


def _psnr_db(image: UInt8Array, other: UInt8Array) -> float:
    error = float(((image.astype(np.float64) - other) ** 2).mean())
    return 10 * math.log10(255**2 / max(error, 1e-9))


PEERS: dict[str, Callable[[Setting, Rasterizer, int], PeerResult]] = {"reference": _reference, "gsplat": _gsplat}
"""Name -> its measurement, given the setting, our rasterizer and the number of the scene's Gaussians."""
