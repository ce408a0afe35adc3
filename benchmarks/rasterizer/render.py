"""`readygo bench render`: images per second, the split per stage, the theoretical bound and a peer.

The method is described in `benchmarks/README.md`.
"""

import json as json_module
import os
import platform
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import binding

from readygo.benchmarks.rasterizer.bound import bound_ms, mean_work, peak_fma_per_s
from readygo.benchmarks.rasterizer.peers import PEERS, PeerResult
from readygo.benchmarks.rasterizer.runs import (
    RUNS,
    Timing,
    images_per_run,
    make_backend,
    measure,
    measure_in_processes,
    no_device,
    stages_ms,
)
from readygo.benchmarks.rasterizer.scenery import gaussian_count
from readygo.benchmarks.rasterizer.setting import Backend, Measurement, Placement, Setting, Switch, open_setting
from readygo.common.cores import available_cores
from readygo.common.errors import ConfigError
from readygo.common.rasterizer.interface import Rasterizer
from readygo.common.rasterizer.packed.scene import PackedScene

BOUND_GAUSSIANS_MAX = 5_000_000
"""Larger scenes are not unpacked again to count their work."""


@dataclass(frozen=True, kw_only=True)
class BenchAvatarOptions:
    """Pedestrians in the images."""

    placement: Placement = "free"
    """Where people stand: on free ground in sight of the camera, or anywhere, even inside of objects."""
    avatar_folder: Path | None = None
    """Folder of avatars; the embedded ones by default."""
    avatar_gaussians: str = ""
    """Gaussians per person, such as 30k; as many as they have by default."""
    motion: Path | None = None
    """How people walk: .npz with root_m and pose_axis_angle; the built-in gait by default."""


@dataclass(frozen=True, kw_only=True)
class BenchRenderOptions:
    """Measure how fast images of a scene with walking people are drawn."""

    scene: str = ""
    """Scene bundle, or "embedded" (the default)."""
    synthetic: str = ""
    """Instead of a scene: a flat of that many Gaussians of SH degree 3, such as 500k, 1.5M or 20M."""
    avatars: int = 2
    """People in every image, 0 to 8, 2 m and more ahead of the camera."""
    size: str = "144x256"
    """Height and width of the image [px]."""
    frames: int = 400
    """Images that each process times."""
    views: int = 20
    """Standpoints of the camera among which they are divided."""
    threads: int = 1
    """Processes of one thread each that draw at the same time; images/s are their sum."""
    backend: Backend = "cpu"
    """Rasterizer to measure."""
    lod: Switch = "off"
    """Level of detail."""
    peers: bool = True
    """Measure the peers and the bound too."""
    seed: int = 0
    """Seed of standpoints, of people's habits and of the synthetic flat."""
    json: bool = False
    """Print one JSON object instead of a table."""
    pedestrians: BenchAvatarOptions = field(default_factory=BenchAvatarOptions)


def bench_render(options: BenchRenderOptions) -> None:
    """Measure how fast images of a scene with walking people are drawn."""
    height_px, width_px = _size(options.size)
    job = Measurement(
        scene=options.scene,
        synthetic=options.synthetic,
        avatars=options.avatars,
        placement=options.pedestrians.placement,
        avatar_folder=options.pedestrians.avatar_folder,
        avatar_gaussians=gaussian_count(options.pedestrians.avatar_gaussians)
        if options.pedestrians.avatar_gaussians
        else None,
        motion=options.pedestrians.motion,
        height_px=height_px,
        width_px=width_px,
        frames=options.frames,
        views=options.views,
        threads=options.threads,
        backend=options.backend,
        lod=options.lod,
        seed=options.seed,
    )
    result = run(job, peers=options.peers)
    sys.stdout.write(json_module.dumps(result) + "\n" if options.json else table(result))


def run(job: Measurement, *, peers: bool = True) -> dict[str, Any]:
    """Measure a job; keys carry units."""
    setting = open_setting(job)
    result = _head(setting)
    missing = no_device(job)
    if missing:
        return {**result, "images_per_s": None, "why_none": missing}
    rasterizer = make_backend(setting)
    layers = setting.scenery.layers()
    gaussians = _gaussians(layers)
    result |= {"gaussians": gaussians, "sh_degree": _degree(layers)}
    timings = [measure(setting, rasterizer)] if job.threads == 1 else measure_in_processes(job)
    result |= speed(timings, wall=job.backend == "gpu")
    if job.backend == "cpu":
        result["stages_ms"] = stages_ms(setting, rasterizer)
    if peers:
        result |= _bound(setting, layers, gaussians, result)
        result["peers"] = _peers(setting, rasterizer, gaussians)
    return result


def _size(text: str) -> tuple[int, int]:
    height, _, width = text.lower().partition("x")
    if not (height.isdigit() and width.isdigit()):
        raise ConfigError(f"--size must be HEIGHTxWIDTH in pixels such as 144x256, got {text!r}.")
    return int(height), int(width)


def _head(setting: Setting) -> dict[str, Any]:
    job = setting.job
    return {
        "machine": machine(),
        "backend": job.backend,
        "lod": job.lod,
        "scene": setting.scenery.name,
        "avatars": job.avatars,
        "placement": job.placement,
        "avatar_gaussians": [len(avatar.cloud) for avatar in setting.avatars],
        "image_px": [job.height_px, job.width_px],
        "threads": job.threads,
        "views": job.views,
        "runs": RUNS,
        "frames": images_per_run(job) * job.views * RUNS,
        "seed": job.seed,
    }


def machine() -> dict[str, Any]:
    """What measures."""
    return {"cpu": _cpu_name(), "cores": available_cores(), "simd": _simd()}


def _cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.partition(": ")[2] for line in lines if line.startswith("model name")), platform.machine())


def _simd() -> str:
    """The widest instructions that kernels are compiled for."""
    named = os.environ.get("NUMBA_CPU_FEATURES")
    features = set(named.split(",")) if named else {f"+{k}" for k, on in binding.get_host_cpu_features().items() if on}
    return next((name for flag, name in (("+avx512f", "AVX-512"), ("+avx2", "AVX2")) if flag in features), "128 bit")


def _gaussians(layers: list[PackedScene]) -> int:
    return sum(int((layer.geometry[:, :, 10] >= 0).sum()) for layer in layers)


def _coefficients(layers: list[PackedScene]) -> int:
    return max(layer.sh.shape[3] if len(layer.sh) else 1 for layer in layers)


def _degree(layers: list[PackedScene]) -> int:
    return {1: 0, 4: 1, 9: 2, 16: 3}[_coefficients(layers)]


def speed(timings: list[Timing], *, wall: bool = False) -> dict[str, Any]:
    """Images per second of all processes together, and the spread over views on one core.

    An image's cost is the least CPU time of its runs, or wall time where a device does the work; a view's is the mean
    over its images.
    """
    spent_s = [timing.wall_s if wall else timing.cpu_s for timing in timings]
    per_view = [seconds.min(axis=0).mean(axis=1) for seconds in spent_s]
    all_views = np.concatenate(per_view)
    fast, median, slow = (1 / float(np.percentile(all_views, q)) for q in (10, 50, 90))
    disturbed = [float(np.median(seconds / seconds.min(axis=0))) - 1 for seconds in spent_s]
    return {
        "images_per_s": sum(1 / float(seconds.mean()) for seconds in per_view),
        "images_per_s_wall": sum(timing.wall_s.size / float(timing.wall_s.sum()) for timing in timings),
        "ms_per_image": 1e3 * float(all_views.mean()),
        "images_per_s_per_core": {"median": median, "p10": slow, "p90": fast, "slowest": 1 / float(all_views.max())},
        "median_run_over_fastest": max(disturbed),
    }


def _bound(setting: Setting, layers: list[PackedScene], gaussians: int, result: dict[str, Any]) -> dict[str, Any]:
    if gaussians > BOUND_GAUSSIANS_MAX or setting.job.backend != "cpu":
        return {}
    work, peak = mean_work(setting), peak_fma_per_s()
    stages = bound_ms(work, setting, _coefficients(layers), peak)
    total_ms = sum(stages.values())
    return {
        "work_per_image": {name: round(count) for name, count in work.items()},
        "peak_fma16_per_s": peak,
        "bound_stages_ms": stages,
        "bound_images_per_s": 1e3 * setting.job.threads / total_ms,
        "share_of_bound": total_ms / result["ms_per_image"],
    }


def _peers(setting: Setting, rasterizer: Rasterizer, gaussians: int) -> dict[str, dict[str, Any]]:
    results: dict[str, PeerResult] = {name: peer(setting, rasterizer, gaussians) for name, peer in PEERS.items()}
    return {name: {k: v for k, v in asdict(peer).items() if v not in (None, "")} for name, peer in results.items()}


def table(result: dict[str, Any]) -> str:
    """The result as aligned text."""
    lines = []
    for key, value in result.items():
        if key in ("bound_stages_ms", "why_none"):
            continue
        if key == "stages_ms":
            bound = result.get("bound_stages_ms", {})
            lines.append(f"{'stages':26s} {'ms':>8s} {'bound ms':>9s}")
            lines += [f"  {stage:24s} {ms:8.2f} {_number(bound.get(stage, '')):>9s}" for stage, ms in value.items()]
        elif isinstance(value, dict):
            lines.append(f"{key:26s} " + ", ".join(f"{name} {_number(item)}" for name, item in value.items()))
        else:
            lines.append(f"{key:26s} {result.get('why_none', '') if value is None else _number(value)}")
    return "\n".join(lines) + "\n"


def _number(value: Any) -> str:
    if isinstance(value, dict):
        return "(" + ", ".join(f"{name} {_number(item)}" for name, item in value.items()) + ")"
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 10 else f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.1f}"
    return f"{value:,}" if isinstance(value, int) else str(value)
