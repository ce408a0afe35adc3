"""What memory a training takes, told before it begins."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch

from readygo.common.errors import RunError
from readygo.services.reconstructor.training.config import GaussiansConfig
from readygo.services.reconstructor.training.photos import KEPT_BYTES, Posed, bytes_of, size_px

PROCESS_BYTES = 450_000_000
"""Memory of Python with its libraries and kernels [bytes]."""
GAUSSIAN_BYTES, GAUSSIAN_VIEW_BYTES, SURFACE_GAUSSIAN_VIEW_BYTES = 1000, 500, 850
"""Memory of a Gaussian with its moments and its share of a checkpoint, and in each view of a step, without and with
surfaces [bytes]. Measured as these and the next ones are: peaks of three steps on 70 images, 9,000 and 150,000
Gaussians."""
PIXEL_VIEW_BYTES, SURFACE_PIXEL_VIEW_BYTES = 350, 650
MEMINFO, LIMIT, USED = Path("/proc/meminfo"), Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current")


def check_memory(posed: Posed, settings: GaussiansConfig) -> None:
    """Refuse a training that would be ended for its memory.

    Raises:
        RunError: If more is needed than there is.
    """
    needed, free = needed_bytes(posed, settings), free_bytes()
    if free is not None and needed > free:
        width, height = largest_px(posed, settings)
        raise RunError(
            f"The training needs about {needed / 1e9:.1f} GB of memory ({settings.density.count_max:,} Gaussians, "
            f"{settings.batch} views a step of {width}x{height} px), {free / 1e9:.1f} GB are free: close other "
            "programs, take a smaller --preset, or lower "
            "density.count_max and side_max_px."
        )


@contextmanager
def gpu_memory(settings: GaussiansConfig) -> Iterator[None]:
    """Word what torch says where the memory of a GPU runs out.

    Raises:
        RunError: In its place.
    """
    try:
        yield
    except torch.OutOfMemoryError as error:
        raise RunError(
            f"The GPU's memory ran out with at most {settings.density.count_max:,} Gaussians: close what else uses it "
            "and run the same command again, or restart with a smaller --preset, or lower "
            "density.count_max and side_max_px."
        ) from error


def needed_bytes(posed: Posed, settings: GaussiansConfig) -> int:
    """Memory of a training with as many Gaussians as it may have."""
    surfaces, batch = settings.geometry.enabled, settings.batch
    of_view = SURFACE_GAUSSIAN_VIEW_BYTES if surfaces else GAUSSIAN_VIEW_BYTES
    of_pixel = SURFACE_PIXEL_VIEW_BYTES if surfaces else PIXEL_VIEW_BYTES
    width, height = largest_px(posed, settings)
    photos = min(bytes_of(posed) * width * height * len(posed.views), KEPT_BYTES)
    if settings.device == "cuda":
        return PROCESS_BYTES + photos + settings.density.count_max * GAUSSIAN_BYTES
    gaussians = settings.density.count_max * (GAUSSIAN_BYTES + batch * of_view)
    return PROCESS_BYTES + photos + batch * width * height * of_pixel + gaussians


def largest_px(posed: Posed, settings: GaussiansConfig) -> tuple[int, int]:
    """Width and height of the largest photo."""
    sizes = (size_px(posed, number, settings.side_max_px, 1) for number in range(len(posed.views)))
    return max(sizes, key=lambda size: size[0] * size[1])


def free_bytes() -> int | None:
    """Memory that this process may still take, as the system and its control group say; None where nothing says it."""
    free = [1024 * int(line.split()[1]) for line in _lines(MEMINFO) if line.startswith("MemAvailable:")]
    limit, used = _lines(LIMIT), _lines(USED)
    if limit and used and limit[0].isdigit():
        free.append(max(int(limit[0]) - int(used[0]), 0))
    return min(free, default=None)


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text().splitlines()
    except OSError:
        return []
