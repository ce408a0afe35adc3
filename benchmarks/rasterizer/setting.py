"""What `readygo bench render` draws: the images of its views, from its command line."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from readygo.benchmarks.rasterizer.scenery import (
    BenchScenery,
    Standpoint,
    open_scenery,
    random_places,
    walk_motion,
    wearers,
)
from readygo.common.avatars import Avatar, load_avatars, pose_avatar
from readygo.common.errors import ConfigError
from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.messages import Motion
from readygo.common.rasterizer.interface import PosedHuman, View
from readygo.common.robot import CameraConfig

Backend = Literal["cpu", "gpu", "reference"]
Switch = Literal["off", "on"]
Placement = Literal["free", "any"]
FIRST_ROW = 40
"""Row of the first person's motion at the first image; the next person is `ROWS_APART` further on."""
ROWS_APART = 23


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A measurement, as its processes are told about it."""

    scene: str = ""
    synthetic: str = ""
    avatars: int = 2
    placement: Placement = "free"
    avatar_folder: Path | None = None
    avatar_gaussians: int | None = None
    motion: Path | None = None
    height_px: int = 144
    width_px: int = 256
    frames: int = 1
    views: int = 12
    threads: int = 1
    backend: Backend = "cpu"
    lod: Switch = "off"
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("frames", "views", "threads"):
            if getattr(self, name) < 1:
                raise ConfigError(f"--{name} must be at least 1, got {getattr(self, name)}.")
        if self.avatars < 0:
            raise ConfigError(f"--avatars must not be negative, got {self.avatars}.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Setting:
    """Scene, camera, standpoints, and people in motion."""

    job: Measurement
    scenery: BenchScenery
    camera: CameraConfig
    places: list[Standpoint]
    avatars: list[Avatar]
    """Avatars of the people, one per person."""
    motions: list[Motion]
    """Motions of the people, one per person."""

    @property
    def wardrobe(self) -> dict[str, Avatar]:
        """The avatars by name."""
        return {avatar.name: avatar for avatar in self.avatars}

    def view(self, place: Standpoint, image: int) -> View:
        """Image number `image` of a standpoint: a step of 0.05 s per image."""
        humans = [self._human(number, place, image) for number in range(len(self.avatars))]
        return View(T_world_camera=place.T_world_camera(self.camera, image), humans=humans)

    def _human(self, number: int, place: Standpoint, image: int) -> PosedHuman:
        motion = self.motions[number]
        first = FIRST_ROW + ROWS_APART * number
        start, row = motion.root_m[first % len(motion.root_m)], (first + image) % len(motion.root_m)
        x_m, y_m, floor_m = place.humans_m[number]
        root_m = motion.root_m[row] + np.array([x_m - start[0], y_m - start[1], floor_m])
        name = self.avatars[number].name
        return PosedHuman(avatar=name, root_m=root_m, pose_axis_angle=motion.pose_axis_angle[row])

    def cloud(self, scene: GaussianCloud, humans: Sequence[PosedHuman]) -> GaussianCloud:
        """One cloud of scene and humans, for renderers that do not pose avatars themselves."""
        bodies = [pose_avatar(self.wardrobe[p.avatar], p.root_m, p.pose_axis_angle) for p in humans]
        return concatenate([scene, *bodies]) if bodies else scene


def open_setting(job: Measurement) -> Setting:
    """Load what a job names.

    Raises:
        ConfigError: If the job cannot be done.
        SceneError: If the scene cannot be used.
        AvatarError: If an avatar cannot be used.
    """
    try:
        camera = CameraConfig(height_px=job.height_px, width_px=job.width_px)
    except ValueError as error:
        raise ConfigError(f"--size: {error}") from error
    scenery = open_scenery(job.scene, job.synthetic, job.seed)
    avatars = wearers(list(load_avatars(job.avatar_folder).values()), job.avatars, job.avatar_gaussians)
    return Setting(
        job=job,
        scenery=scenery,
        camera=camera,
        places=random_places(scenery, job.avatars, job.views, job.seed, in_sight=job.placement == "free"),
        avatars=avatars,
        motions=[walk_motion(avatar, job.motion, job.seed + number) for number, avatar in enumerate(avatars)],
    )
