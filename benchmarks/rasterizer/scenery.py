"""Scenes to measure on, cameras in their free space, and people who walk before them."""

import hashlib
import math
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from readygo.benchmarks.rasterizer import synthetic_room
from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.common.avatars import Avatar
from readygo.common.errors import ConfigError
from readygo.common.files import cache_folder
from readygo.common.frames import matrix_from_quat
from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.maps import FloorMap, OccupancyMap, clearance_m, largest_free_area
from readygo.common.messages import Motion
from readygo.common.rasterizer.backends import packed_cloud
from readygo.common.rasterizer.packed.scene import PackedScene, load_or_pack
from readygo.common.robot import CameraConfig
from readygo.common.robot.kinematics import DT_S
from readygo.common.scenes import Scene
from readygo.runs.scene_argument import open_scene
from readygo.services.animator import skeleton_of, walk
from readygo.services.renderer import pack_folder, static_clouds

TURN_RAD = 0.01
"""The camera's turn per image: 0.2 rad/s at 20 Hz."""
AHEAD = ((2.0, 0.5), (3.0, -0.7), (2.6, -0.2), (4.0, 0.8), (3.6, 0.1), (5.0, -1.0), (4.6, 0.4), (6.0, 0.0))
"""Where people stand [m]: forward and left of the camera."""
FREE_RADIUS_M = 0.3
_TRIES = 200


@dataclass(frozen=True, kw_only=True, eq=False)
class BenchScenery:
    """A scene as benchmarks need it."""

    name: str
    layers: Callable[[], list[PackedScene]]
    """Its packs, mapped from a cache that all processes share."""
    cloud: Callable[[], GaussianCloud]
    """All its Gaussians, sky included, for slow peers."""
    occupancy: OccupancyMap
    floor: FloorMap


@dataclass(frozen=True, kw_only=True, eq=False)
class Standpoint:
    """A camera's standpoint, and where people stand before it."""

    x_m: float
    y_m: float
    yaw_rad: float
    floor_m: float
    humans_m: tuple[tuple[float, float, float], ...]
    """Point on the floor of each person at the first image."""

    def T_world_camera(self, camera: CameraConfig, image: int) -> Float64Array:
        """Pose at image number `image`."""
        return camera.T_world_camera(self.x_m, self.y_m, self.yaw_rad + TURN_RAD * image, self.floor_m)


def scene_scenery(scene: Scene) -> BenchScenery:
    """A bundle's scenery."""
    return BenchScenery(
        name=scene.name,
        layers=lambda: [packed_cloud(cloud, pack_folder(scene)) for cloud in static_clouds(scene)],
        cloud=lambda: scene.cloud if scene.sky is None else concatenate([scene.cloud, scene.sky]),
        occupancy=scene.maps.robot,
        floor=scene.maps.floor,
    )


def synthetic_scenery(count: int, seed: int) -> BenchScenery:
    """The synthetic flat with `count` Gaussians; packed once into the user's cache.

    Packs that another version of `synthetic_room.py` has left there are removed.
    """
    source = hashlib.sha256(Path(synthetic_room.__file__).read_bytes()).hexdigest()[:12]
    folder = cache_folder("benchmarks") / f"room-{source}-{count}-{seed}"
    for stale in folder.parent.glob("room-*"):
        if not stale.name.startswith(f"room-{source}-"):
            shutil.rmtree(stale, ignore_errors=True)
    occupancy, floor = synthetic_room.room_maps(seed)
    return BenchScenery(
        name=f"synthetic flat, seed {seed}",
        layers=lambda: [load_or_pack(folder, lambda: synthetic_room.room_cloud(count, seed))],
        cloud=lambda: synthetic_room.room_cloud(count, seed),
        occupancy=occupancy,
        floor=floor,
    )


def open_scenery(scene: str, synthetic: str, seed: int) -> BenchScenery:
    """The scenery of the command line's `--scene` and `--synthetic`; the embedded scene if both are empty.

    Raises:
        ConfigError: If both are given, or the number cannot be read.
        SceneError: If the bundle cannot be used.
    """
    if scene and synthetic:
        raise ConfigError("--scene and --synthetic exclude each other; give one of them.")
    if synthetic:
        return synthetic_scenery(gaussian_count(synthetic), seed)
    return scene_scenery(open_scene(scene or "embedded"))


def gaussian_count(text: str) -> int:
    """Number of Gaussians of texts such as 30000, 500k or 1.5M.

    Raises:
        ConfigError: If the text is no number of 1,000 to 100 million.
    """
    factor = {"k": 1e3, "m": 1e6}.get(text[-1:].lower(), 1.0)
    try:
        count = round(float(text[:-1] if factor > 1 else text) * factor)
    except (ValueError, OverflowError):
        count = 0
    if not 1000 <= count <= 100_000_000:
        raise ConfigError(f"a number of Gaussians must be 1k to 100M, got {text!r}; write 30000, 500k or 1.5M.")
    return count


def random_places(
    scenery: BenchScenery, humans: int, count: int, seed: int, *, in_sight: bool = True
) -> list[Standpoint]:
    """Standpoints and headings in the largest free area.

    Args:
        scenery: Scene.
        humans: How many stand before the camera, at the distances of `AHEAD`.
        count: Standpoints.
        seed: Seed of the draw.
        in_sight: Draw again, up to `_TRIES` times, until all people stand on free ground and nothing of the map is in
            the way to them; otherwise they stand as they come, in furniture and behind walls too.

    Raises:
        ConfigError: If there are too many people, or there is no free area.
    """
    if humans > len(AHEAD):
        raise ConfigError(f"--avatars must be 0 to {len(AHEAD)}, got {humans}.")
    rng = np.random.default_rng(seed)
    clear = clearance_m(scenery.occupancy) > FREE_RADIUS_M
    cells = np.argwhere(largest_free_area(scenery.occupancy, FREE_RADIUS_M)[0])
    if len(cells) == 0:
        raise ConfigError(f"scene {scenery.name!r} has no free area for a camera; import it for a smaller robot.")
    places = []
    for _ in range(count):
        for _ in range(_TRIES):
            place = _place(scenery, cells[rng.integers(len(cells))], float(rng.uniform(-math.pi, math.pi)), humans)
            if not in_sight or all(_in_sight(scenery.occupancy, clear, place, point) for point in place.humans_m):
                break
        places.append(place)
    return places


def _place(scenery: BenchScenery, cell: Int64Array, yaw_rad: float, humans: int) -> Standpoint:
    x_m, y_m = scenery.occupancy.frame.centre_m(int(cell[0]), int(cell[1]))
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    points = [(x_m + c * forward - s * left, y_m + s * forward + c * left) for forward, left in AHEAD[:humans]]
    return Standpoint(
        x_m=x_m,
        y_m=y_m,
        yaw_rad=yaw_rad,
        floor_m=scenery.floor.at(x_m, y_m),
        humans_m=tuple((x, y, scenery.floor.at(x, y)) for x, y in points),
    )


def _in_sight(occupancy: OccupancyMap, clear: BoolArray, place: Standpoint, point: tuple[float, float, float]) -> bool:
    """True if the straight way to a point is not blocked, and the point itself is clear."""
    rows, columns = occupancy.occupied.shape
    for step in range(1, 41):
        x_m = place.x_m + (point[0] - place.x_m) * step / 40
        y_m = place.y_m + (point[1] - place.y_m) * step / 40
        row, column = occupancy.frame.cell(x_m, y_m)
        if not (0 <= row < rows and 0 <= column < columns) or occupancy.occupied[row, column]:
            return False
    return bool(clear[row, column])


def walk_motion(avatar: Avatar, path: Path | None, seed: int) -> Motion:
    """A walk from a file (.npz with root_m and pose_axis_angle), or of the built-in gait: 10 s in large curves.

    Raises:
        ConfigError: If the file is no motion.
    """
    if path is not None:
        try:
            with np.load(path, allow_pickle=False) as arrays:
                return Motion(root_m=arrays["root_m"], pose_axis_angle=arrays["pose_axis_angle"])
        except (KeyError, ValueError, EOFError) as error:
            raise ConfigError(f"{path} is no motion (root_m, pose_axis_angle): {error}.") from error
    heading = 0.9 * np.sin(0.9 * 1.2 * DT_S * np.arange(200))
    steps = np.stack([np.cos(heading), np.sin(heading)], axis=1) * 0.06
    floor = synthetic_room.room_maps()[1]
    return walk(skeleton_of(avatar), np.cumsum(steps, axis=0), floor, np.random.default_rng(seed))


def with_gaussian_count(avatar: Avatar, count: int, seed: int = 0) -> Avatar:
    """The avatar with `count` Gaussians, of about the same look.

    Fewer: a random choice, enlarged so that they still cover the surface. More: copies scattered within the originals
    and made smaller.
    """
    rng = np.random.default_rng(seed)
    cloud, size = avatar.cloud, len(avatar.cloud)
    whole, rest = divmod(count, size)
    index = np.concatenate([np.tile(np.arange(size), whole), np.sort(rng.permutation(size)[:rest])])
    chosen = cloud.select(index)
    means, scales = chosen.means_m, chosen.scales_m * np.float32(math.sqrt(size / count))
    if count > size:
        R = matrix_from_quat(chosen.quats_wxyz)
        local = 0.5 * chosen.scales_m * rng.standard_normal((count, 3))
        means = (means + np.einsum("nij,nj->ni", R, local)).astype(np.float32)
    return replace(
        avatar,
        cloud=replace(chosen, means_m=means, scales_m=scales),
        lbs_index=avatar.lbs_index[index],
        lbs_weight=avatar.lbs_weight[index],
    )


def wearers(avatars: Sequence[Avatar], humans: int, count: int | None) -> list[Avatar]:
    """Who the people are: the avatars in turn, with `count` Gaussians each if it is given."""
    chosen = [avatars[k % len(avatars)] for k in range(humans)]
    return chosen if count is None else [with_gaussian_count(avatar, count) for avatar in chosen]
