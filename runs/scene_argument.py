"""The SCENE argument of commands: a bundle's folder, the embedded scene, or a map."""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from readygo.common.errors import RunError, SceneError
from readygo.common.files import cache_folder
from readygo.common.maps import FloorMap, OccupancyMap, SightMap, load_ros_map, sight_of_occupancy
from readygo.common.scenes import Scene, load_scene
from readygo.services.planner import PlanningMaps

NO_SCENE = 'Name a scene: a bundle, or "embedded".'
"""What a command without a scene is told."""
LARGEST_SEED = 2**31 - 1
"""Largest seed of an embedded flat."""
OWN_PLAN = "plan-"
"""Stands before the seed of a flat whose plan is drawn."""


def open_scene(scene: str) -> Scene:
    """Open the scene of a command-line argument.

    "embedded", "embedded:SEED" and "embedded:plan-SEED" are made once and stored in the user's cache.

    Raises:
        SceneError: If the argument names no scene bundle.
    """
    name, colon, seed = scene.partition(":")
    if name != "embedded":
        return load_scene(Path(scene))
    own_plan, number = seed.startswith(OWN_PLAN), seed.removeprefix(OWN_PLAN)
    if colon and not (number.isdecimal() and int(number) <= LARGEST_SEED):
        raise SceneError(
            f"{scene}: give a whole number up to {LARGEST_SEED} as the seed, as in embedded:1 or embedded:{OWN_PLAN}1."
        )
    from readygo.common.scenes.embedded import ensure_embedded_scene, scene_name

    flat = int(number or 0)
    folder = cache_folder("scenes") / scene_name(flat, own_plan=own_plan)
    return ensure_embedded_scene(folder, flat, own_plan=own_plan)


def open_scenes(scenes: Sequence[str]) -> list[Scene]:
    """Open the different scenes of a command-line argument, see `open_scene`.

    Raises:
        RunError: If no scene is named, or one twice.
        SceneError: If one is no scene bundle.
    """
    if not scenes:
        raise RunError(NO_SCENE)
    opened: dict[str, Scene] = {}
    for name in scenes:
        scene = open_scene(name)
        if scene.content_hash in opened:
            raise RunError(f"Scene {name} is named twice; name each scene once.")
        opened[scene.content_hash] = scene
    return list(opened.values())


class FlatMaps:
    """One map on a flat floor: the same cells block robot and humans."""

    def __init__(self, occupancy: OccupancyMap) -> None:
        self.robot = self.human = occupancy
        self.floor = FloorMap(frame=self.robot.frame, height_m=np.zeros(self.robot.occupied.shape, np.float32))

    @cached_property
    def sight(self) -> SightMap:
        """Visibility map, in which occupied cells hide humans."""
        return sight_of_occupancy(self.robot)


def open_maps(scene: str) -> tuple[PlanningMaps, Scene | None]:
    """Open the maps of a scene, or a ROS map (.yaml), which has no scene.

    Raises:
        SceneError: If the argument names neither.
    """
    if scene.endswith((".yaml", ".yml")):
        return FlatMaps(load_ros_map(scene)), None
    bundle = open_scene(scene)
    return bundle.maps, bundle
