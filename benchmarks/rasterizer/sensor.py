"""Cost of a frame with each part of the sensor, next to the same frame without.

    python -m readygo.benchmarks.rasterizer.sensor scenes/lobby --avatars AVATARS --motion walk.npz

A robot turns at 0.8 rad/s at random standpoints of the scene's free area while two people walk in full sight before it.
All variants draw a view one after the other, several times, and the fastest time of each counts: CPU time of this
thread.
"""

import json
import math
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from readygo.benchmarks.rasterizer.scenery import Standpoint
from readygo.benchmarks.rasterizer.setting import Measurement, Setting, open_setting
from readygo.common.avatars import Avatar
from readygo.common.messages import HumanMotion, Motion
from readygo.common.robot import CameraConfig, RobotConfig, step_unicycle
from readygo.common.scenes import Scene, load_scene
from readygo.services.renderer import SENSOR_RECIPES, Renderer, RendererConfig, Shot, path_poses

LIGHT = "human light"
FEET = "feet on floor"
SHADOW = "contact shadow"
PHONE = "sensor_phone_like, 4 sub-frames"
SHADED_PHONE = "sensor_phone_like, contact shadow"
OPTICS: Mapping[str, Mapping[str, Any]] = {
    "off": {},
    LIGHT: {},
    FEET: {},
    SHADOW: {},
    "exposure, vignetting, noise": {"exposure_ev": 0.2, "vignetting": 0.2, "shot_noise": 0.02, "read_noise": 0.002},
    "Brown-Conrady lens": {"distortion": "brown_conrady", "k1": -0.04},
    "fisheye lens": {"distortion": "fisheye"},
    "motion blur, 8 sub-frames": {"exposure_s": 0.01},
    PHONE: {},
    SHADED_PHONE: {},
}
"""What each variant changes of the camera, besides the recipe."""
STEPS = 12


def main(
    scene: Path,
    /,
    *,
    avatars: Path | None = None,
    motion: Path | None = None,
    views: int = 8,
    runs: int = 5,
    height_px: int = 144,
    width_px: int = 256,
    fov_deg: float = 100.0,
    seed: int = 0,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure.

    Args:
        scene: Scene bundle.
        avatars: Folder of avatars; the embedded ones by default.
        motion: .npz with root_m and pose_axis_angle; the built-in gait by default.
        views: Camera poses.
        runs: Runs per view, of which the fastest counts.
        height_px: Image height.
        width_px: Image width.
        fov_deg: Horizontal field of view.
        seed: Seed of the camera poses.
        json_output: Print JSON.
    """
    camera = CameraConfig(height_px=height_px, width_px=width_px, horizontal_fov_deg=fov_deg)
    job = Measurement(scene=str(scene), avatar_folder=avatars, motion=motion, views=views, seed=seed)
    setting = replace(open_setting(job), camera=camera)
    loaded, people = load_scene(scene), {one.name: one for one in setting.avatars}
    renderers = {name: _renderer(name, loaded, people, camera) for name in OPTICS}
    shots = [_shot(setting, place) for place in setting.places]
    frame_s = {name: 0.0 for name in OPTICS}
    for shot in shots:
        best = {name: math.inf for name in OPTICS}
        for _ in range(runs):
            for name, renderer in renderers.items():
                renderer.episode_camera("", shot.episode)
                begin_s = time.thread_time()
                list(renderer.render([shot]))
                best[name] = min(best[name], time.thread_time() - begin_s)
        for name, seconds in best.items():
            frame_s[name] += seconds / views
    if json_output:
        print(json.dumps({"frame_ms": {name: 1e3 * seconds for name, seconds in frame_s.items()}}))
        return
    for name, seconds in frame_s.items():
        pinhole = renderers[name].pinholes[""]
        print(f"{name:36} {1e3 * seconds:7.1f} ms   drawn at {pinhole.height_px}x{pinhole.width_px} px")


def _renderer(name: str, scene: Scene, people: Mapping[str, Avatar], camera: CameraConfig) -> Renderer:
    shadow = name in (SHADOW, SHADED_PHONE)
    config = RendererConfig(contact_shadow=shadow, feet_on_floor=shadow or name == FEET, human_light=name == LIGHT)
    camera = replace(camera, **OPTICS[name])
    if name in (PHONE, SHADED_PHONE):
        camera, config = SENSOR_RECIPES["sensor_phone_like"](camera, config)
    return Renderer(scene, people, RobotConfig(camera=camera), config)


def _shot(setting: Setting, place: Standpoint) -> Shot:
    """A robot that turns at a place, and people who walk on from where they stand at its middle step."""
    rows = [(place.x_m, place.y_m, place.yaw_rad)]
    for _ in range(STEPS):
        rows.append(step_unicycle(*rows[-1], 0.3, 0.8, RobotConfig().clock.dt_s))
    views = [setting.view(place, step).humans for step in range(STEPS)]
    humans = tuple(
        HumanMotion(
            avatar=avatar.name,
            motion=Motion(
                root_m=np.array([people[number].root_m for people in views], dtype=np.float32),
                pose_axis_angle=np.array([people[number].pose_axis_angle for people in views], dtype=np.float32),
            ),
        )
        for number, avatar in enumerate(setting.avatars)
    )
    return Shot(step=STEPS - 2, pose_at=path_poses(np.array(rows), setting.scenery.floor), humans=humans)


if __name__ == "__main__":
    tyro.cli(main)
