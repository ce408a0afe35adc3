"""Timed drawing: backends, runs, the split per stage, several processes at once."""

import hashlib
import importlib.util
import multiprocessing
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing.synchronize import Barrier
from types import ModuleType
from typing import Any

import numpy as np

from readygo.benchmarks.rasterizer.setting import Measurement, Setting, open_setting
from readygo.common.arrays import Float64Array
from readygo.common.avatars.file import avatar_hash
from readygo.common.errors import ConfigError
from readygo.common.files import cache_folder
from readygo.common.rasterizer.cpu import blend as cpu_blend
from readygo.common.rasterizer.cpu import rasterizer as cpu
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.gpu.availability import require_kernels
from readygo.common.rasterizer.interface import Rasterizer, View
from readygo.common.rasterizer.lod.files import load_or_build_avatar_tree, load_or_build_tree
from readygo.common.rasterizer.packed.scene import PackedScene
from readygo.common.rasterizer.reference import ReferenceRasterizer
from readygo.common.rasterizer.warm import warm

STAGES: dict[str, tuple[tuple[ModuleType, str], ...]] = {
    "cull": tuple(
        (cpu, name) for name in ("cull_scene", "cull_human", "cull_tree", "cull_human_tree", "joint_transforms")
    ),
    "project_scene": ((cpu, "project_scene"),),
    "pose_and_project_people": ((cpu, "project_human"),),
    "sort": ((cpu_blend, "begin_slab"), (cpu_blend, "sort_keys")),
    "bin": ((cpu_blend, "fill_tiles"),),
    "blend": ((cpu_blend, "begin_image"), (cpu_blend, "blend_tiles"), (cpu_blend, "write_bytes")),
}
"""Stage -> the functions of the CPU rasterizer that belong to it: the module that calls them, and their name there."""
RUNS = 4
"""How often the same images are drawn; the fastest counts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Timing:
    """What one process measured; the images are the same in every run."""

    cpu_s: Float64Array
    """CPU time of the thread, shape (runs, views, images)."""
    wall_s: Float64Array
    """Wall time [s], shape (runs, views, images)."""


def no_device(job: Measurement) -> str:
    """Why the backend cannot be measured on this machine, or ""."""
    return "" if job.backend != "gpu" or _has_gpu() else "no gpu"


def _has_gpu() -> bool:
    if importlib.util.find_spec("torch") is None:
        return False
    import torch

    return bool(torch.cuda.is_available())


def make_backend(setting: Setting) -> Rasterizer:
    """The job's rasterizer of a setting.

    Raises:
        ConfigError: If the backend lacks what the job asks for.
    """
    job = setting.job
    if job.lod == "on" and job.backend != "cpu":
        raise ConfigError(f"--lod on: only the backend cpu has levels of detail, got {job.backend!r}; use --lod off.")
    return BACKENDS[job.backend](setting)


def _cpu(setting: Setting) -> Rasterizer:
    warm()
    return make_cpu(setting, lod=setting.job.lod == "on")


def make_cpu(setting: Setting, *, lod: bool) -> CpuRasterizer:
    """The CPU rasterizer of a setting, with levels of detail or exact."""
    camera, layers = setting.camera, setting.scenery.layers()
    size = camera.height_px, camera.width_px
    if not lod:
        return CpuRasterizer(layers, setting.wardrobe, camera.K_px, *size)
    trees = [
        load_or_build_tree(cache_folder("benchmarks") / f"lod-{digest(layer)}", partial(_itself, layer))
        for layer in layers
    ]
    packed = {
        name: load_or_build_avatar_tree(cache_folder("benchmarks") / f"lod-{avatar_hash(avatar)[:16]}", avatar)
        for name, avatar in setting.wardrobe.items()
    }
    return CpuRasterizer(trees, setting.wardrobe, camera.K_px, *size, packed_avatars=packed)


def _itself(layer: PackedScene) -> PackedScene:
    return layer


def digest(layer: PackedScene) -> str:
    """Short hash of a pack."""
    arrays = (layer.centre_m, layer.geometry, layer.colour, layer.sh)
    return hashlib.sha256(b"".join(hashlib.sha256(array.data).digest() for array in arrays)).hexdigest()[:16]


def _reference(setting: Setting) -> Rasterizer:
    return ReferenceRasterizer([setting.scenery.cloud()], setting.wardrobe, setting.camera)


def make_gpu(setting: Setting, kernels: str) -> Rasterizer:
    """The GPU's rasterizer of a setting, one view per call here; `benchmarks/rasterizer/gpu.py` measures batches.

    Raises:
        ReadygoError: If the kernels cannot run here.
    """
    require_kernels(kernels, "cuda")
    from readygo.common.rasterizer.gpu.rasterizer import GpuRasterizer

    camera = setting.camera
    clouds = [setting.scenery.cloud()]
    size = camera.height_px, camera.width_px
    return GpuRasterizer(clouds, setting.wardrobe, camera.K_px, *size, kernels=kernels)


BACKENDS: dict[str, Callable[[Setting], Rasterizer]] = {
    "cpu": _cpu,
    "gpu": partial(make_gpu, kernels="triton"),
    "reference": _reference,
}


def images_per_run(job: Measurement) -> int:
    """Timed images per view and run: at least one."""
    return max(1, job.frames // (job.views * RUNS))


def measure(setting: Setting, rasterizer: Rasterizer, wait: Callable[[], object] = lambda: None) -> Timing:
    """Draw all views, `RUNS` times.

    Before the clock starts, every view is drawn once; the first image of every view in every run is not timed, because
    the view before it was another place.

    Args:
        setting: What to draw.
        rasterizer: Draws, one view at a time.
        wait: Called between warm-up and measurement.
    """
    count = images_per_run(setting.job)
    views = [[setting.view(place, image) for image in range(count + 1)] for place in setting.places]
    for images in views:
        rasterizer.render([images[0]])
    wait()
    cpu_s, wall_s = np.empty((2, RUNS, len(views), count))
    for run in range(RUNS):
        for number, images in enumerate(views):
            rasterizer.render([images[0]])
            for image in range(count):
                cpu, wall = time.thread_time(), time.perf_counter()
                rasterizer.render([images[image + 1]])
                cpu_s[run, number, image] = time.thread_time() - cpu
                wall_s[run, number, image] = time.perf_counter() - wall
    return Timing(cpu_s=cpu_s, wall_s=wall_s)


_barrier: Barrier | None = None


def _keep_barrier(barrier: Barrier) -> None:
    global _barrier
    _barrier = barrier


def _measure_in_process(job: Measurement, number: int) -> Timing:
    assert _barrier is not None
    try:
        setting = open_setting(job)
        # Each process begins at another view, so that they do not read the same chunks at the same time.
        first = number * len(setting.places) // job.threads
        setting.places[:] = setting.places[first:] + setting.places[:first]
        return measure(setting, make_backend(setting), _barrier.wait)
    except BaseException:
        _barrier.abort()
        raise


def measure_in_processes(job: Measurement) -> list[Timing]:
    """Measure in `job.threads` processes that start together when all are warm."""
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(job.threads)
    with ProcessPoolExecutor(job.threads, context, _keep_barrier, (barrier,)) as pool:
        pending = [pool.submit(_measure_in_process, job, number) for number in range(job.threads)]
        return [future.result() for future in pending]


def stages_ms(setting: Setting, rasterizer: Rasterizer) -> dict[str, float]:
    """CPU time per image of each stage of the CPU rasterizer [ms], and of everything else."""
    images = [view for place in setting.places for view in _stage_images(setting, place)]
    with _clocks() as spent_s:
        begin_s = time.thread_time()
        for view in images:
            rasterizer.render([view])
        total_s = time.thread_time() - begin_s
    stages = {name: 1e3 * seconds / len(images) for name, seconds in spent_s.items()}
    return {**stages, "everything_else": 1e3 * total_s / len(images) - sum(stages.values())}


def _stage_images(setting: Setting, place: Any) -> list[View]:
    return [setting.view(place, image) for image in range(max(4, images_per_run(setting.job)))]


@contextmanager
def _clocks() -> Iterator[dict[str, float]]:
    """Time the functions of each stage while the block runs; a function within another one counts for itself only."""
    spent_s = dict.fromkeys(STAGES, 0.0)
    inner_s = [0.0]

    def clocked(stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **options: Any) -> Any:
            inner_s.append(0.0)
            begin_s = time.thread_time()
            result = function(*args, **options)
            whole_s = time.thread_time() - begin_s
            spent_s[stage] += whole_s - inner_s.pop()
            inner_s[-1] += whole_s
            return result

        return call

    clocked_functions = [function for functions in STAGES.values() for function in functions]
    originals = [
        (module, name, getattr(module, name)) for module, name in [(cpu_blend, "draw_slab"), *clocked_functions]
    ]
    # One kernel calls several stages; from Python, its body calls the clocked ones.
    cpu_blend.draw_slab = cpu_blend.draw_slab.py_func
    for stage, functions in STAGES.items():
        for module, name in functions:
            setattr(module, name, clocked(stage, getattr(module, name)))
    try:
        yield spent_s
    finally:
        for module, name, function in originals:
            setattr(module, name, function)
