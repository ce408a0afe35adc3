"""Images per second and per-stage times of the CPU rasterizer on one core, next to the reference backend.

    python benchmarks/render.py scenes/lobby --people 2 --motion walk.npz

Camera poses are drawn at random from the free area of the scene's robot map; people walk 2 and 3 m ahead of the camera.
Every view is drawn a few times while the camera turns by 0.01 rad per image, as on a robot, and the fastest of several
such runs counts. Times are CPU times of this thread.
"""

import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common.avatars import Avatar, load_avatars
from common.maps import largest_free_area
from common.messages import HumanMotion, Motion
from common.rasterizer import cpu, cpu_blend
from common.rasterizer.cpu import CpuRasterizer, PosedPerson
from common.rasterizer.warm import warm
from common.robot import CameraConfig
from common.scenes import Scene, load_scene
from services.renderer.drawing import ReferenceDrawing, packed_layers

STAGES: dict[str, tuple[Any, tuple[str, ...]]] = {
    "cull": (cpu, ("cull_scene", "cull_person", "joint_transforms")),
    "project_scene": (cpu, ("project_scene",)),
    "pose_and_project_people": (cpu, ("project_person",)),
    "sort": (cpu_blend, ("begin_slab", "sort_keys")),
    "bin": (cpu_blend, ("fill_tiles",)),
    "blend": (cpu_blend, ("blend_tiles",)),
    "io": (cpu_blend, ("begin_image", "write_bytes")),
}
IMAGES_PER_RUN = 4
TURN_RAD = 0.01


@dataclass(frozen=True)
class Place:
    """A camera pose and the people in front of it."""

    x_m: float
    y_m: float
    yaw_rad: float
    humans: tuple[HumanMotion, ...]


def main(
    scene: Path,
    /,
    *,
    avatars: Path | None = None,
    motion: Path | None = None,
    people: int = 2,
    views: int = 12,
    runs: int = 4,
    height_px: int = 144,
    width_px: int = 256,
    reference_views: int = 1,
    seed: int = 0,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure.

    Args:
        scene: Scene bundle.
        avatars: Folder of avatars; the embedded ones by default.
        motion: .npz with root_m and pose_axis_angle; people stand in the T-pose without it.
        people: People in front of the camera, 0 to 2.
        views: Camera poses.
        runs: Runs per view, of which the fastest counts.
        height_px: Image height.
        width_px: Image width.
        reference_views: Views that the reference backend draws as well.
        seed: Seed of the camera poses.
        json_output: Print JSON.
    """
    warm()
    loaded, wearers = load_scene(scene), load_avatars(avatars)
    camera = CameraConfig(height_px=height_px, width_px=width_px)
    layers = packed_layers(loaded)
    rasterizer = CpuRasterizer(layers, list(wearers.values()), camera.K_px, height_px, width_px)
    places = list(random_places(loaded, wearers, _motion(motion), people, views, seed))
    image_s = [min(_run(rasterizer, loaded, camera, wearers, place) for _ in range(runs)) for place in places]
    result: dict[str, Any] = {
        "scene": loaded.name,
        "gaussians": sum(int((layer.geometry[:, :, 10] >= 0).sum()) for layer in layers),
        "people": people,
        "people_gaussians": sum(len(wearers[human.avatar].cloud) for human in places[0].humans),
        "image_px": [height_px, width_px],
        "images_per_s": 1 / float(np.mean(image_s)),
        "slowest_view_images_per_s": 1 / max(image_s),
        "stages_ms": _stages_ms(rasterizer, loaded, camera, wearers, places),
    }
    if reference_views:
        drawing = ReferenceDrawing(loaded, wearers, camera)
        result |= _against_reference(drawing, rasterizer, loaded, camera, wearers, places[:reference_views])
    print(json.dumps(result) if json_output else _table(result))


def random_places(
    scene: Scene, avatars: dict[str, Avatar], motion: Motion, people: int, count: int, seed: int
) -> Iterator[Place]:
    """Places in the robot's free area, with people ahead."""
    rng = np.random.default_rng(seed)
    occupancy = scene.maps.robot
    cells = np.argwhere(largest_free_area(occupancy, 0.3)[0])
    names = sorted(avatars)
    for row, column in cells[rng.integers(0, len(cells), count)]:
        x_m, y_m = occupancy.frame.centre_m(int(row), int(column))
        yaw_rad = float(rng.uniform(-math.pi, math.pi))
        ahead = ((2.0, 0.5, 40), (3.0, -0.7, 63))[:people]
        humans = [
            _human(names[k % len(names)], motion, step, x_m, y_m, yaw_rad, forward_m, left_m)
            for k, (forward_m, left_m, step) in enumerate(ahead)
        ]
        yield Place(x_m, y_m, yaw_rad, tuple(humans))


def _human(
    avatar: str, motion: Motion, step: int, x_m: float, y_m: float, yaw_rad: float, forward_m: float, left_m: float
) -> HumanMotion:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    row = motion.row(step)
    root = motion.root_m[row : row + 1].copy()
    root[0, :2] = x_m + c * forward_m - s * left_m, y_m + s * forward_m + c * left_m
    return HumanMotion(avatar=avatar, motion=Motion(root_m=root, pose_axis_angle=motion.pose_axis_angle[row : row + 1]))


def _motion(path: Path | None) -> Motion:
    if path is None:
        root = np.array([[0.0, 0.0, 0.95]], dtype=np.float32)
        return Motion(root_m=root, pose_axis_angle=np.zeros((1, 24, 3), dtype=np.float32))
    arrays = np.load(path, allow_pickle=False)
    return Motion(root_m=arrays["root_m"], pose_axis_angle=arrays["pose_axis_angle"])


def _view(scene: Scene, camera: CameraConfig, place: Place, turn_rad: float = 0.0) -> Any:
    floor_m = scene.maps.floor.at(place.x_m, place.y_m)
    return camera.T_world_camera(place.x_m, place.y_m, place.yaw_rad + turn_rad, floor_m)


def _people(avatars: dict[str, Avatar], place: Place) -> list[PosedPerson]:
    number = {name: k for k, name in enumerate(avatars)}
    return [
        PosedPerson(
            avatar=number[human.avatar],
            root_m=human.motion.root_m[0],
            pose_axis_angle=human.motion.pose_axis_angle[0],
        )
        for human in place.humans
    ]


def _run(
    rasterizer: CpuRasterizer, scene: Scene, camera: CameraConfig, avatars: dict[str, Avatar], place: Place
) -> float:
    """CPU time of one image, the first of the run left out [s]."""
    people = _people(avatars, place)
    poses = [_view(scene, camera, place, TURN_RAD * k) for k in range(IMAGES_PER_RUN)]
    rasterizer.render(poses[0], people)
    begin_s = time.thread_time()
    for pose in poses[1:]:
        rasterizer.render(pose, people)
    return (time.thread_time() - begin_s) / (IMAGES_PER_RUN - 1)


def _stages_ms(
    rasterizer: CpuRasterizer,
    scene: Scene,
    camera: CameraConfig,
    avatars: dict[str, Avatar],
    places: list[Place],
) -> dict[str, float]:
    with _clocks() as spent_s:
        begin_s = time.thread_time()
        for place in places:
            people = _people(avatars, place)
            for k in range(IMAGES_PER_RUN):
                rasterizer.render(_view(scene, camera, place, TURN_RAD * k), people)
        total_s = time.thread_time() - begin_s
    images = len(places) * IMAGES_PER_RUN
    stages = {name: 1e3 * seconds / images for name, seconds in spent_s.items()}
    return {**stages, "everything_else": 1e3 * total_s / images - sum(stages.values())}


@contextmanager
def _clocks() -> Iterator[dict[str, float]]:
    """Time the kernels of each stage while the block runs."""
    spent_s = dict.fromkeys(STAGES, 0.0)
    originals = [(cpu_blend, "draw_slab", cpu_blend.draw_slab)] + [
        (module, name, getattr(module, name)) for module, names in STAGES.values() for name in names
    ]

    def clocked(stage: str, kernel: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any) -> Any:
            begin_s = time.thread_time()
            result = kernel(*args)
            spent_s[stage] += time.thread_time() - begin_s
            return result

        return call

    # The body of this kernel calls the stages, clocked, from Python.
    cpu_blend.draw_slab = cpu_blend.draw_slab.py_func
    for stage, (module, names) in STAGES.items():
        for name in names:
            setattr(module, name, clocked(stage, getattr(module, name)))
    try:
        yield spent_s
    finally:
        for module, name, kernel in originals:
            setattr(module, name, kernel)


def _against_reference(
    drawing: ReferenceDrawing,
    rasterizer: CpuRasterizer,
    scene: Scene,
    camera: CameraConfig,
    avatars: dict[str, Avatar],
    places: list[Place],
) -> dict[str, float]:
    begin_s = time.thread_time()
    slow = [drawing.draw(_view(scene, camera, place), place.humans, 0) for place in places]
    reference_s = (time.thread_time() - begin_s) / len(places)
    fast = [rasterizer.render(_view(scene, camera, place), _people(avatars, place)) for place in places]
    error = np.stack(slow).astype(np.float64) - np.stack(fast)
    return {
        "reference_images_per_s": 1 / reference_s,
        "psnr_to_reference_db": 10 * math.log10(255**2 / max(float((error**2).mean()), 1e-12)),
        "share_of_values_off_by_more_than_2": float((np.abs(error) > 2).mean()),
    }


def _table(result: dict[str, Any]) -> str:
    stages = result.pop("stages_ms")
    lines = [f"{key:36s} {f'{value:.4g}' if isinstance(value, float) else value}" for key, value in result.items()]
    lines += [f"  {stage:34s} {value:.2f} ms" for stage, value in stages.items()]
    return "\n".join(lines)


if __name__ == "__main__":
    tyro.cli(main)
