"""What the renderer draws: the clouds of a scene bundle, humans at a step of their motions, their shadows."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from readygo.common.avatars import Avatar
from readygo.common.avatars.mesh_look import fixed_light, mesh_like
from readygo.common.gaussians import load_gaussians
from readygo.common.lighting.probes import LightProbes, load_or_make_probes, make_probes
from readygo.common.maps import FloorMap, OccupancyMap
from readygo.common.messages import HumanMotion
from readygo.common.rasterizer.backends import StaticCloud, make_rasterizer, packed_cloud
from readygo.common.rasterizer.interface import PinholeCamera, PosedHuman, Rasterizer, View
from readygo.common.scenes import Scene
from readygo.common.scenes.scene import CLOUD_FILE, SKY_FILE
from readygo.services.renderer.config import RendererConfig
from readygo.services.renderer.contact_shadow import shadow_cloud
from readygo.services.renderer.feet import feet_of, stands_of
from readygo.services.renderer.sensor.motion import posed

Pose = npt.NDArray[np.float64]
Light = Callable[[float, float], npt.NDArray[np.float64]]
"""Light at a place x, y [m], as in `irradiance_matrix`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawing:
    """A scene that can be drawn."""

    rasterizer: Rasterizer
    skeletons: Mapping[str, Avatar]
    """The avatars without their Gaussians."""
    floor: FloorMap
    obstacles: OccupancyMap | None = None
    """Feet are drawn before the floor, but not before these; None draws them as their depths say."""
    shadows: bool = False
    """False leaves humans without shadows."""
    light: Light | None = None
    """The light that humans walk in; None draws them in their avatars' own colours."""

    def view(self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: float, K_px: Pose | None = None) -> View:
        """The scene with `humans` at simulation step `step`, which need not be whole; see `View.K_px`."""
        there = posed(humans, step)
        feet = feet_of(self.skeletons, there)
        shadows = shadow_cloud(feet, self.floor, T_world_camera[:3, 3]) if self.shadows else None
        if self.obstacles is None:
            stands: list[list[float]] = [[0.0, 0.0]] * len(there)
        else:
            stands = stands_of(feet, self.floor, self.obstacles, T_world_camera).tolist()
        here = [self._placed(human, *stand) for human, stand in zip(there, stands, strict=True)]
        return View(T_world_camera=T_world_camera, humans=tuple(here), shadows=shadows, K_px=K_px)

    def _placed(self, human: PosedHuman, ground_m: float, lead_m: float) -> PosedHuman:
        light = None if self.light is None else self.light(float(human.root_m[0]), float(human.root_m[1]))
        return dataclasses.replace(human, light=light, ground_m=ground_m, lead_m=lead_m)


def make_drawing(scene: Scene, avatars: Mapping[str, Avatar], camera: PinholeCamera, config: RendererConfig) -> Drawing:
    """A scene with its avatars, ready to be drawn.

    Args:
        scene: The scene bundle.
        avatars: Avatars by name.
        camera: What the rasterizer draws with; not the robot's camera where its lens distorts.
        config: Settings.

    Raises:
        ReadygoError: If the backend cannot run here.
    """
    mesh = config.human_look == "mesh"
    rasterizer = make_rasterizer(
        config.backend,
        static_clouds(scene),
        {name: mesh_like(avatar) for name, avatar in avatars.items()} if mesh else avatars,
        camera,
        cache=pack_folder(scene),
        outputs=config.rasterized(config.outputs),
        detail=config.detail,
    )
    return Drawing(
        rasterizer=rasterizer,
        skeletons={name: avatar.skeleton() for name, avatar in avatars.items()},
        floor=scene.maps.floor,
        obstacles=scene.maps.robot if config.draws("feet_on_floor") else None,
        shadows=config.draws("contact_shadow"),
        light=_light(scene, config),
    )


def _light(scene: Scene, config: RendererConfig) -> Light | None:
    if config.human_look == "mesh":
        fixed = fixed_light()
        return lambda *_: fixed
    return scene_probes(scene).at if config.human_light else None


def scene_probes(scene: Scene) -> LightProbes:
    """The probes of a scene's light, from its cache or made there."""

    def make() -> LightProbes:
        clouds = [packed_cloud(cloud, pack_folder(scene)) for cloud in static_clouds(scene)]
        return make_probes(clouds, scene.maps.human, scene.maps.floor)

    return load_or_make_probes(pack_folder(scene) / f"light-{scene.content_hash[:16]}.npz", make)


def static_clouds(scene: Scene) -> list[StaticCloud]:
    """The scene and, if it has one, its sky."""
    files = [CLOUD_FILE, *([SKY_FILE] if SKY_FILE in scene.metadata["files"] else [])]
    return [
        StaticCloud(key=f"{scene.content_hash[:16]}-{Path(name).stem}", load=partial(load_gaussians, scene.path / name))
        for name in files
    ]


def pack_folder(scene: Scene) -> Path:
    """Folder of the bundle's packs, which can be made again."""
    return scene.path / "cache"
