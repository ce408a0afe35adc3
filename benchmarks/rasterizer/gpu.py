"""Images per second of the GPU rasterizer over batches of cameras, after a check against the CPU rasterizer.

    python -m readygo.benchmarks.rasterizer.gpu out/showroom --avatars AVATARS --motion WALK.npz --out gpu_h200.json

Every camera of a batch stands somewhere in the free area of the scene's robot map and sees its own three walking
people. Times are wall times with the device's work awaited, of batches that differ from one to the next; poses and
joint rotations are uploaded and people are posed within them. Without a GPU it prints `no gpu`.
"""

import itertools
import json
import math
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from readygo.common.avatars import Avatar, load_avatars
from readygo.common.errors import ReadygoError
from readygo.common.maps import largest_free_area
from readygo.common.messages import Motion
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman, View
from readygo.common.rasterizer.packed.scene import pack_cloud
from readygo.common.robot import CameraConfig
from readygo.common.scenes import Scene, load_scene

AHEAD_M = ((2.0, 0.5), (3.0, -0.7), (4.0, 0.1))
"""Where people walk: ahead and to the left of their camera [m]."""
BATCHES_IN_TURN = 3
"""Batches that are drawn in turn, so that no cache holds what the next one needs."""


@dataclass(frozen=True)
class GpuJob:
    """What is drawn, and where."""

    scene: Scene
    avatars: dict[str, Avatar]
    camera: CameraConfig
    views: list[View]
    device: str

    def rasterizer(self, kernels: str, settings: Any = None) -> Any:
        """A rasterizer of the scene, its sky and the avatars."""
        from readygo.common.rasterizer.gpu.rasterizer import GpuRasterizer

        clouds = [cloud for cloud in (self.scene.cloud, self.scene.sky) if cloud is not None]
        camera = self.camera
        return GpuRasterizer(
            clouds, self.avatars, camera.K_px, camera.height_px, camera.width_px,
            kernels=kernels, device=self.device, settings=settings,
        )  # fmt: skip

    def batch(self, number: int, size: int) -> list[View]:
        """One of the batches of `size` views."""
        return [self.views[(number * size + k) % len(self.views)] for k in range(size)]


def main(
    scene: Path,
    /,
    *,
    avatars: Path | None = None,
    motion: Path | None = None,
    people: int = 3,
    batches: tuple[int, ...] = (1, 16, 64, 256),
    kernels: tuple[str, ...] = ("triton", "gsplat"),
    height_px: int = 144,
    width_px: int = 256,
    checks: int = 8,
    seconds: float = 3.0,
    sweep: bool = True,
    device: str = "cuda",
    out: Path | None = None,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Check and measure.

    Args:
        scene: Scene bundle.
        avatars: Folder of avatars; the embedded ones by default.
        motion: .npz with root_m and pose_axis_angle; people stand in the T-pose without it.
        people: People that each camera sees, 0 to 3.
        batches: Cameras per call.
        kernels: Whose kernels.
        height_px: Image height.
        width_px: Image width.
        checks: Views that are compared with the CPU rasterizer.
        seconds: Time that each measurement takes at least [s].
        sweep: Try other settings of the Triton kernels too.
        device: A CUDA device; "cpu" under Triton's interpreter tries this program out.
        out: Where to write the result as JSON.
        json_output: Print JSON.
    """
    machine = _machine(device)
    if machine is None:
        print(json.dumps({"gpu": None, "note": "no gpu"}) if json_output else "no gpu")
        return
    camera = CameraConfig(height_px=height_px, width_px=width_px)
    loaded, wearers = load_scene(scene), load_avatars(avatars)
    count = max(BATCHES_IN_TURN * max(batches), checks)
    views = list(_views(loaded, wearers, camera, _motion(motion), people, count))
    job = GpuJob(loaded, wearers, camera, views, device)
    result: dict[str, Any] = {
        **machine,
        "scene": loaded.name,
        "gaussians": len(loaded.cloud) + (0 if loaded.sky is None else len(loaded.sky)),
        "people": people,
        "people_gaussians": sum(len(wearers[human.avatar].cloud) for human in views[0].humans),
        "image_px": [height_px, width_px],
        "kernels": {},
    }
    for name in kernels:
        try:
            result["kernels"][name] = _measure(job, name, batches, checks, seconds, sweep)
        except ReadygoError as error:
            result["kernels"][name] = {"error": str(error)}
        # Written after each part: what was measured is kept if the next part fails.
        if out is not None:
            out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result) if json_output else json.dumps(result, indent=2))


def _machine(device: str) -> dict[str, Any] | None:
    """What the measurements ran on; None without a GPU."""
    try:
        import torch
    except ImportError:
        return None
    if device == "cpu":
        return {"gpu": "none: interpreted", "torch": torch.__version__}
    if not torch.cuda.is_available():
        return None
    properties = torch.cuda.get_device_properties(device)
    return {
        "gpu": properties.name,
        "gpu_memory_gib": properties.total_memory / 2**30,
        "multiprocessors": properties.multi_processor_count,
        "torch": torch.__version__,
        "cuda": torch.version.cuda,
    }


def _measure(
    job: GpuJob, name: str, batches: Sequence[int], checks: int, seconds: float, sweep: bool
) -> dict[str, Any]:
    """Correctness first, then speed."""
    begin_s = time.perf_counter()
    rasterizer = job.rasterizer(name)
    rasterizer.render(job.views[:1])
    result: dict[str, Any] = {"first_image_after_s": time.perf_counter() - begin_s}
    result["against_cpu"] = _against_cpu(job, rasterizer, checks)
    result["batches"] = [_speed(job, rasterizer, size, seconds) for size in batches]
    if name == "triton":
        result["stages"] = [_stages_ms(job, rasterizer, size) for size in batches]
        if sweep:
            result["sweep"] = list(_sweep(job, batches, seconds))
    return result


def _against_cpu(job: GpuJob, rasterizer: Any, checks: int) -> dict[str, Any]:
    camera, clouds = job.camera, [job.scene.cloud, *([job.scene.sky] if job.scene.sky is not None else [])]
    cpu = CpuRasterizer(
        [pack_cloud(cloud) for cloud in clouds], job.avatars, camera.K_px, camera.height_px,
        camera.width_px,
    )  # fmt: skip
    views = job.batch(0, checks)
    ours = rasterizer.render(views).rgb.astype(np.float64)
    error = ours - cpu.render(views).rgb
    again = rasterizer.render(views).rgb
    return {
        "views": checks,
        "psnr_db": 10 * math.log10(255**2 / max(float((error**2).mean()), 1e-12)),
        "largest_difference": float(np.abs(error).max()),
        "share_of_values_off_by_more_than_2": float((np.abs(error) > 2).mean()),
        "same_bytes_again": bool(np.array_equal(ours, again)),
    }


def _speed(job: GpuJob, rasterizer: Any, size: int, seconds: float) -> dict[str, Any]:
    """Images per second with images left on the device, and with images copied to the host."""
    on_device = _run_times_s(job, rasterizer.render_on_device, size, seconds)
    to_host = _run_times_s(job, rasterizer.render, size, seconds)
    return {
        "cameras": size,
        "images_per_s": size / statistics.median(on_device),
        "images_per_s_to_host": size / statistics.median(to_host),
        "runs": len(on_device),
        "ms_per_batch_spread": [1e3 * min(on_device), 1e3 * max(on_device)],
        "peak_memory_gib": _peak_memory_gib(job.device),
    }


def _run_times_s(job: GpuJob, draw: Any, size: int, seconds: float) -> list[float]:
    inputs = [job.batch(number, size) for number in range(BATCHES_IN_TURN)]
    for views in inputs:
        draw(views)
    times_s: list[float] = []
    while len(times_s) < 3 or sum(times_s) < seconds:
        views = inputs[len(times_s) % len(inputs)]
        _await(job.device)
        begin_s = time.perf_counter()
        draw(views)
        _await(job.device)
        times_s.append(time.perf_counter() - begin_s)
    return times_s


def _stages_ms(job: GpuJob, rasterizer: Any, size: int) -> dict[str, float]:
    """Device time of each stage per image [ms], from events between the launches."""
    marks: list[tuple[str, Any]] = []
    rasterizer.set_clock(lambda stage: marks.append((stage, _mark(job.device))))
    rasterizer.render_on_device(job.batch(1, size))
    marks.append(("end", _mark(job.device)))
    _await(job.device)
    rasterizer.set_clock(lambda stage: None)
    stages: dict[str, float] = {}
    for (stage, begin), (_, end) in itertools.pairwise(marks):
        stages[stage] = stages.get(stage, 0.0) + _elapsed_ms(begin, end) / size
    return {"cameras": float(size), **{f"{stage}_ms": value for stage, value in stages.items()}}


def _sweep(job: GpuJob, batches: Sequence[int], seconds: float) -> Iterator[dict[str, Any]]:
    """Other tiles, slabs, launches and sizes of passes, one changed at a time."""
    from readygo.common.rasterizer.gpu.triton.settings import TritonSettings

    base, most = TritonSettings(), max(batches)
    changes: list[tuple[int, dict[str, Any]]] = [
        *((most, {"tile_width_px": w, "tile_height_px": h}) for w, h in ((8, 8), (16, 16))),
        (most, {"tile_width_px": 16, "tile_height_px": 16, "blend_warps": 2}),
        *((most, {"slab_shares": shares}) for shares in ((), (0.25,), (0.15, 0.4), (0.1, 0.2, 0.3, 0.5, 0.7))),
        *((most, {"sort_run": run, "sort_warps": warps}) for run, warps in ((64, 1), (128, 1), (512, 2), (1024, 4))),
        *((most, {"long_sort_run": run, "long_sort_warps": warps}) for run, warps in ((512, 4), (2048, 8))),
        *((most, {"project_warps": warps}) for warps in (4,)),
        *((most, {"programs_per_processor": count}) for count in (4, 16)),
        *((most, {"cameras_per_pass": count}) for count in (32, 128, 256)),
    ]
    for size, change in changes:
        settings = replace(base, **change)
        times_s = _run_times_s(job, job.rasterizer("triton", settings).render_on_device, size, seconds / 3)
        yield {"cameras": size, "settings": asdict(settings), "images_per_s": size / statistics.median(times_s)}


def _mark(device: str) -> Any:
    import torch

    if device == "cpu":
        return time.perf_counter()
    event = torch.cuda.Event(enable_timing=True)
    event.record()
    return event


def _elapsed_ms(begin: Any, end: Any) -> float:
    return 1e3 * (end - begin) if isinstance(begin, float) else float(begin.elapsed_time(end))


def _await(device: str) -> None:
    import torch

    if device != "cpu":
        torch.cuda.synchronize(device)


def _peak_memory_gib(device: str) -> float:
    import torch

    return 0.0 if device == "cpu" else torch.cuda.max_memory_allocated(device) / 2**30


def _views(
    scene: Scene, avatars: dict[str, Avatar], camera: CameraConfig, motion: Motion, people: int, count: int
) -> Iterator[View]:
    """Cameras in the robot's free area, with people ahead of them, each in a different pose."""
    rng = np.random.default_rng(0)
    occupancy = scene.maps.robot
    names = list(avatars)
    cells = np.argwhere(largest_free_area(occupancy, 0.3)[0])
    for row, column in cells[rng.integers(0, len(cells), count)]:
        x_m, y_m = occupancy.frame.centre_m(int(row), int(column))
        yaw_rad = float(rng.uniform(-math.pi, math.pi))
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        group = []
        for k, (forward_m, left_m) in enumerate(AHEAD_M[:people]):
            step = int(rng.integers(0, len(motion.root_m)))
            root = motion.root_m[step].copy()
            root[:2] = x_m + c * forward_m - s * left_m, y_m + s * forward_m + c * left_m
            pose = motion.pose_axis_angle[step]
            group.append(PosedHuman(avatar=names[k % len(names)], root_m=root, pose_axis_angle=pose))
        T_world_camera = camera.T_world_camera(x_m, y_m, yaw_rad, scene.maps.floor.at(x_m, y_m))
        yield View(T_world_camera=T_world_camera, humans=tuple(group))


def _motion(path: Path | None) -> Motion:
    if path is None:
        root = np.array([[0.0, 0.0, 0.95]], dtype=np.float32)
        return Motion(root_m=root, pose_axis_angle=np.zeros((1, 24, 3), dtype=np.float32))
    arrays = np.load(path, allow_pickle=False)
    return Motion(root_m=arrays["root_m"], pose_axis_angle=arrays["pose_axis_angle"])


if __name__ == "__main__":
    tyro.cli(main)
