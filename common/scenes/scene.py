"""A scene bundle on disk, read piece by piece when it is needed."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.array_files import load_npy
from readygo.common.arrays import Float32Array
from readygo.common.camera.captured import CapturedViews, load_views
from readygo.common.documents import read_json
from readygo.common.errors import SceneError
from readygo.common.gaussians import GaussianCloud, load_gaussians
from readygo.common.maps import FloorMap, GridFrame, MapConfig, OccupancyMap, SightMap, load_ros_map, sight_of_cloud
from readygo.common.scenes.manifest import MANIFEST, SceneFile, combined_hash, file_of, grid_digest, read_manifest

CLOUD_FILE = "scene.ply"
SKY_FILE = "sky.ply"
ROBOT_MAP_FILE = "maps/robot.yaml"
HUMAN_MAP_FILE = "maps/human.yaml"
FLOOR_FILE = "maps/floor_height_m.npy"
REPORT_FILE = "report.json"
VIEWS_FILE = "cameras.json"
FILMED_FILE = "maps/filmed_share.npy"
RECONSTRUCTION_FILE = "reconstruction.json"
_REMEDY = "import the scene again"
_GRID_BYTES_MAX = 2**28
"""Largest file of a grid [bytes]: 33 million cells in double precision."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneMaps:
    """The maps of a scene; each is read when it is first used."""

    folder: Path
    """Folder of the scene's bundle."""
    floor_frame: GridFrame
    """Frame of the floor's grid in the world."""
    config: MapConfig
    """Settings that the maps were made with."""

    @cached_property
    def robot(self) -> OccupancyMap:
        """What blocks the robot, not inflated."""
        return load_ros_map(self.folder / ROBOT_MAP_FILE)

    @cached_property
    def human(self) -> OccupancyMap:
        """What blocks humans, not inflated."""
        return load_ros_map(self.folder / HUMAN_MAP_FILE)

    @cached_property
    def floor(self) -> FloorMap:
        """Height of the local floor."""
        path = self.folder / FLOOR_FILE
        try:
            height_m = load_npy(path, bytes_max=_GRID_BYTES_MAX, raises=SceneError, remedy=_REMEDY)
            return FloorMap(frame=self.floor_frame, height_m=height_m)
        except ValueError as error:
            raise SceneError(f"Floor map {path} cannot be read: {error}; import the scene again.") from error

    @cached_property
    def filmed_share(self) -> Float32Array | None:
        """How much of what is seen from each cell of the robot's map was filmed, 0 to 1, shape (H, W); see `filmed`.

        None where no cameras are known.
        """
        path = self.folder / FILMED_FILE
        if not path.is_file():
            return None
        return load_npy(path, bytes_max=_GRID_BYTES_MAX, raises=SceneError, remedy=_REMEDY).astype(np.float32)

    @cached_property
    def sight(self) -> SightMap:
        """What hides humans from a camera, made from the Gaussians, which are not kept."""
        robot = self.robot
        shape = (robot.occupied.shape[0], robot.occupied.shape[1])
        return sight_of_cloud(load_gaussians(self.folder / CLOUD_FILE), self.floor, robot.frame, shape, self.config)


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A scene bundle. Gaussians and maps are read when they are first used."""

    name: str
    """Name that the scene was given on import."""
    path: Path
    """Folder of the bundle."""
    content_hash: str
    """Hash of Gaussians, sky and maps; equal for equal content, however its files are compressed."""
    metadata: Mapping[str, Any]
    """The parsed `scene.toml`: license, frame, source, settings of the maps, counts."""

    @property
    def license(self) -> str:
        """Terms under which the scene may be used; empty if the bundle states none."""
        return str(self.metadata.get("license", ""))

    @cached_property
    def cloud(self) -> GaussianCloud:
        """The Gaussians, metres, z up, without the sky."""
        return load_gaussians(self.path / CLOUD_FILE)

    @cached_property
    def sky(self) -> GaussianCloud | None:
        """Gaussians of the far surroundings in the same frame, or None."""
        return load_gaussians(self.path / SKY_FILE) if SKY_FILE in self.metadata["files"] else None

    @cached_property
    def views(self) -> CapturedViews | None:
        """The cameras that it was filmed with, metres, z up; None where they are not known."""
        return load_views(self.path / VIEWS_FILE) if VIEWS_FILE in self.metadata["files"] else None

    @cached_property
    def reconstruction(self) -> dict[str, Any] | None:
        """The report of its reconstruction (scale, verdict on its poses, training); None if it came as Gaussians."""
        if RECONSTRUCTION_FILE not in self.metadata["files"]:
            return None
        path = self.path / RECONSTRUCTION_FILE
        try:
            return dict(read_json(path))
        except (OSError, ValueError, TypeError) as error:
            raise SceneError(f"{path} cannot be read: {error}; import the scene again.") from error

    @cached_property
    def maps(self) -> SceneMaps:
        """Occupancy of robot and human, and the floor."""
        floor = self.metadata["floor"]
        frame = GridFrame(**{key: float(floor[key]) for key in ("origin_x_m", "origin_y_m", "resolution_m")})
        known = {field.name for field in dataclasses.fields(MapConfig)}
        config = MapConfig(**{key: value for key, value in self.metadata["maps"].items() if key in known})
        return SceneMaps(folder=self.path, floor_frame=frame, config=config)

    @cached_property
    def files(self) -> tuple[SceneFile, ...]:
        """All files that make up the bundle, the manifest among them; caches and pictures are left out."""
        listed = [SceneFile(path=name, **entry) for name, entry in self.metadata["files"].items()]
        return (*listed, file_of(self.path, MANIFEST))


def load_scene(path: str | Path) -> Scene:
    """Open a scene bundle; checks its manifest and the sizes of its files, and reads nothing else.

    Args:
        path: Folder that `readygo scene import --out` made.

    Raises:
        SceneError: If `path` is no bundle, or it is damaged.
    """
    path = Path(path)
    manifest = read_manifest(path)
    try:
        scene = Scene(name=manifest["name"], path=path, content_hash=manifest["content_hash"], metadata=manifest)
        _ = scene.maps
    except (KeyError, TypeError, ValueError) as error:
        raise SceneError(f"{path / MANIFEST} is incomplete ({error!r}); import the scene again.") from error
    return scene


def verify_scene(scene: Scene) -> None:
    """Read everything and compare it with the hashes of the manifest.

    Raises:
        SceneError: If a file or the content hash differs.
    """
    for name, entry in scene.metadata["files"].items():
        if file_of(scene.path, name).sha256 != entry["sha256"]:
            raise SceneError(f"Scene {scene.path} is damaged: {name} has changed; import the scene again.")
    if combined_hash(content_digests(scene)) != scene.content_hash:
        raise SceneError(f"Scene {scene.path} is damaged: its content hash differs; import the scene again.")


def content_digests(scene: Scene) -> dict[str, str]:
    """Digest of each part that makes the scene what it is, by name; reads every file."""
    clouds = [name for name in (CLOUD_FILE, SKY_FILE) if (scene.path / name).is_file()]
    maps = scene.maps
    return {
        **{name: file_of(scene.path, name).sha256 for name in clouds},
        "maps/robot": grid_digest(maps.robot.occupied, maps.robot.frame),
        "maps/human": grid_digest(maps.human.occupied, maps.human.frame),
        "maps/floor": grid_digest(maps.floor.height_m, maps.floor.frame),
    }
