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
from readygo.common.gaussians import GaussianCloud, load_gaussians
from readygo.common.lighting.probes import LightProbes, load_or_make_probes, make_probes
from readygo.common.messages import HumanMotion
from readygo.common.rasterizer.backends import StaticCloud, make_rasterizer, packed_cloud
from readygo.common.rasterizer.interface import PinholeCamera, PosedHuman, Rasterizer, View
from readygo.common.scenes import Scene
from readygo.common.scenes.scene import CLOUD_FILE, SKY_FILE
from readygo.services.renderer.config import RendererConfig
from readygo.services.renderer.contact_shadow import shadow_cloud
from readygo.services.renderer.sensor.motion import posed

Pose = npt.NDArray[np.float64]
Light = Callable[[float, float], npt.NDArray[np.float64]]
"""Light at a place x, y [m], as in `irradiance_matrix`."""
Shadows = Callable[[Sequence[PosedHuman], Pose], GaussianCloud | None]
"""Makes the shadows of humans for a camera centre [m], shape (3,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawing:
    """A scene that can be drawn."""

    rasterizer: Rasterizer
    shadows: Shadows | None = None
    """None leaves humans without shadows."""
    light: Light | None = None
    """The light that humans walk in; None draws them in their avatars' own colours."""

    def view(self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: float) -> View:
        """The scene with `humans` at simulation step `step`, which need not be whole."""
        there = tuple(self._lit(human) for human in posed(humans, step))
        shadows = None if self.shadows is None else self.shadows(there, T_world_camera[:3, 3])
        return View(T_world_camera=T_world_camera, humans=there, shadows=shadows)

    def _lit(self, human: PosedHuman) -> PosedHuman:
        if self.light is None:
            return human
        return dataclasses.replace(human, light=self.light(float(human.root_m[0]), float(human.root_m[1])))


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
        outputs=config.outputs,
        detail=config.detail,
    )
    skeletons = {name: avatar.skeleton() for name, avatar in avatars.items()}
    return Drawing(
        rasterizer=rasterizer,
        shadows=partial(_shadows, skeletons, scene) if config.contact_shadow else None,
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
    """Where the bundle keeps its packs, which can be made again."""
    return scene.path / "cache"


def _shadows(
    skeletons: Mapping[str, Avatar], scene: Scene, humans: Sequence[PosedHuman], p_WC: Pose
) -> GaussianCloud | None:
    return shadow_cloud(skeletons, humans, scene.maps.floor, p_WC)
