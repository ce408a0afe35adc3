"""Cost of a frame with each part of the sensor, next to the same frame without.

    python benchmarks/sensor.py scenes/lobby --avatars AVATARS --motion walk.npz

Camera poses are drawn at random from the free area of the scene's robot map; a robot turns there at 0.8 rad/s while
two people walk 2 and 3 m ahead. All variants draw a view one after the other, several times, and the fastest time of
each counts: CPU time of this thread.
"""

import json
import math
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common.avatars import load_avatars
from common.maps import largest_free_area
from common.messages import HumanMotion, Motion
from common.robot import CameraConfig, RobotConfig, step_unicycle
from common.scenes import Scene, load_scene
from services.renderer import Renderer, RendererConfig
from services.renderer.sensor import SensorConfig, sensor_phone_like
from services.renderer.sensor_motion import Timeline
from services.renderer.sensor_streams import SensorStream

VARIANTS: Mapping[str, RendererConfig] = {
    "off": RendererConfig(),
    "contact shadow": RendererConfig(contact_shadow=True),
    "exposure, vignetting, noise": RendererConfig(
        sensor=SensorConfig(exposure_ev=0.2, vignetting=0.2, shot_noise=0.02, read_noise=0.002)
    ),
    "Brown-Conrady lens": RendererConfig(sensor=SensorConfig(distortion="brown_conrady", k1=-0.04)),
    "fisheye lens": RendererConfig(sensor=SensorConfig(distortion="fisheye")),
    "motion blur, 8 sub-frames": RendererConfig(sensor=SensorConfig(exposure_s=0.01)),
    "sensor_phone_like, 4 sub-frames": RendererConfig(sensor=sensor_phone_like()),
    "sensor_phone_like, contact shadow": RendererConfig(sensor=sensor_phone_like(), contact_shadow=True),
}
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
        motion: .npz with root_m and pose_axis_angle; people stand in the T-pose without it.
        views: Camera poses.
        runs: Runs per view, of which the fastest counts.
        height_px: Image height.
        width_px: Image width.
        fov_deg: Horizontal field of view.
        seed: Seed of the camera poses.
        json_output: Print JSON.
    """
    loaded, people = load_scene(scene), load_avatars(avatars)
    robot = RobotConfig(camera=CameraConfig(height_px=height_px, width_px=width_px, horizontal_fov_deg=fov_deg))
    renderers = {name: Renderer(loaded, people, robot, config) for name, config in VARIANTS.items()}
    rng = np.random.default_rng(seed)
    timelines = [_timeline(loaded, sorted(people), _motion(motion), robot, rng) for _ in range(views)]
    frame_s = {name: 0.0 for name in VARIANTS}
    for timeline in timelines:
        best = {name: math.inf for name in VARIANTS}
        for _ in range(runs):
            for name, renderer in renderers.items():
                camera = renderer.capture.camera_of(SensorStream((1, 2)))
                begin_s = time.thread_time()
                renderer.capture.take(camera, timeline.at, STEPS - 2)
                best[name] = min(best[name], time.thread_time() - begin_s)
        for name, seconds in best.items():
            frame_s[name] += seconds / views
    if json_output:
        print(json.dumps({"frame_ms": {name: 1e3 * seconds for name, seconds in frame_s.items()}}))
        return
    for name, seconds in frame_s.items():
        pinhole = renderers[name].capture.pinhole
        print(f"{name:36} {1e3 * seconds:7.1f} ms   drawn at {pinhole.height_px}x{pinhole.width_px} px")


def _motion(path: Path | None) -> Motion:
    if path is None:
        return Motion(root_m=np.zeros((1, 3), np.float32), pose_axis_angle=np.zeros((1, 24, 3), np.float32))
    arrays = np.load(path)
    root_m = (arrays["root_m"] - arrays["root_m"][0] * (1, 1, 0)).astype(np.float32)
    return Motion(root_m=root_m, pose_axis_angle=arrays["pose_axis_angle"].astype(np.float32))


def _timeline(scene: Scene, names: list[str], motion: Motion, robot: RobotConfig, rng: np.random.Generator) -> Timeline:
    """A robot that turns at a free place, and two people ahead of it."""
    occupancy = scene.maps.robot
    cells = np.argwhere(largest_free_area(occupancy, 0.3)[0])
    row, column = cells[rng.integers(len(cells))]
    x_m, y_m = occupancy.frame.centre_m(int(row), int(column))
    rows = [(x_m, y_m, float(rng.uniform(-math.pi, math.pi)))]
    for _ in range(STEPS):
        rows.append(step_unicycle(*rows[-1], 0.3, 0.8))
    yaw_rad, floor_m = rows[STEPS // 2][2], scene.maps.floor.at(x_m, y_m)
    humans = tuple(
        HumanMotion(
            avatar=names[index % len(names)],
            motion=Motion(
                root_m=motion.root_m
                + np.array(
                    [x_m + away_m * math.cos(yaw_rad), y_m + away_m * math.sin(yaw_rad), floor_m], dtype=np.float32
                ),
                pose_axis_angle=motion.pose_axis_angle,
            ),
        )
        for index, away_m in enumerate((2.0, 3.0))
    )
    return Timeline(xyyaw=np.array(rows), humans=humans, floor=scene.maps.floor, camera=robot.camera)


if __name__ == "__main__":
    tyro.cli(main)
