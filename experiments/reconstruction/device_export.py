"""Raw data of Polycam of a simulated capture, with the depth images of a phone's LiDAR sensor.

readygo scene capture SCENE --photos --marker-size-m 0 --out out/shots
python -m experiments.reconstruction.device_export out/shots --out out/polycam [--noise 0.01]
readygo reconstruct out/polycam --out out/lobby
python -m experiments.reconstruction.surfaces out/shots.truth.json out/lobby

Images are the capture's without distortion. Depths are those of the scene's median Gaussians at 256 px, with a relative
error of each pixel; beyond the sensor's reach they have low confidence. Poses are the true ones.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from experiments.reconstruction.rows import print_row
from readygo.apps.capture.truth import Truth, read_truth, truth_path
from readygo.common.arrays import Float32Array, Float64Array, UInt8Array, UInt16Array
from readygo.common.camera import CameraConfig
from readygo.common.files import unfinished_folder
from readygo.common.frames import swap_opengl_axes
from readygo.common.rasterizer.interface import View
from readygo.common.robot import RobotConfig
from readygo.common.scenes import Scene, load_scene
from readygo.services.renderer import Renderer, RendererConfig

SIDE_PX, REACH_M = 256, 5.0
HIGH = 255
R_ARKIT_WORLD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From z up to y up."""


def write_export(shots: Path, truth: Truth, scene: Scene, folder: Path, noise: float, seed: int) -> int:
    """Write `keyframes/` of all photos of a capture; returns how many there are."""
    lens = truth.content["camera"]
    size = (int(truth.content["width_px"]), int(truth.content["height_px"]))
    keyframes, rng = folder / "keyframes", np.random.default_rng(seed)
    for name in ("corrected_images", "corrected_cameras", "depth", "confidence"):
        (keyframes / name).mkdir(parents=True)
    camera = _pinhole(lens, size)
    renderer = Renderer(scene, {}, RobotConfig(camera=camera), RendererConfig(outputs=("rgb", "median_depth")))
    for name, T in truth.poses.items():
        stem = Path(name).stem
        photo = cv2.imread(str(shots / name))
        cv2.imwrite(str(keyframes / "corrected_images" / name), _undistort(photo, lens), [cv2.IMWRITE_JPEG_QUALITY, 97])
        (keyframes / "corrected_cameras" / f"{stem}.json").write_text(json.dumps(_camera_row(T, lens, size)))
        drawn = renderer.rasterizers[""].render([View(T_world_camera=T)], ("rgb", "median_depth"))[0]
        assert drawn.median_depth_m is not None
        depth_mm, confidence = sensor_depths(drawn.median_depth_m, noise, rng)
        cv2.imwrite(str(keyframes / "depth" / f"{stem}.png"), depth_mm)
        cv2.imwrite(str(keyframes / "confidence" / f"{stem}.png"), confidence)
    return len(truth.poses)


def sensor_depths(depth_m: Float32Array, noise: float, rng: np.random.Generator) -> tuple[UInt16Array, UInt8Array]:
    """Depths with a relative error of each pixel [mm], and their confidence, 0 or 255, shape (H, W)."""
    measured = np.isfinite(depth_m) & (depth_m < REACH_M)
    noisy_m = np.where(np.isfinite(depth_m), depth_m, 0.0) * (1.0 + noise * rng.normal(size=depth_m.shape))
    return np.rint(1000.0 * noisy_m).clip(0, 65535).astype(np.uint16), (HIGH * measured).astype(np.uint8)


def _pinhole(lens: dict[str, Any], size_px: tuple[int, int]) -> CameraConfig:
    """The camera of the depth images."""
    share = SIDE_PX / max(size_px)
    numbers = {f"{name}_px": share * lens[name] for name in ("fx", "fy", "cx", "cy")}
    return CameraConfig(width_px=round(size_px[0] * share), height_px=round(size_px[1] * share), **numbers)


def _undistort(photo: Any, lens: dict[str, Any]) -> Any:
    # OpenCV has the centre of the first pixel at 0.
    K = np.array([[lens["fx"], 0.0, lens["cx"] - 0.5], [0.0, lens["fy"], lens["cy"] - 0.5], [0.0, 0.0, 1.0]])
    return cv2.undistort(photo, K, np.array([lens[name] for name in ("k1", "k2", "p1", "p2")]))


def _camera_row(T_world_camera: Float64Array, lens: dict[str, Any], size_px: tuple[int, int]) -> dict[str, float]:
    T = swap_opengl_axes(T_world_camera[None])[0]
    T = np.column_stack([R_ARKIT_WORLD @ T[:3, :3], R_ARKIT_WORLD @ T[:3, 3]])
    pose = {f"t_{i}{j}": float(T[i, j]) for i in range(3) for j in range(4)}
    return {
        **pose,
        **{name: lens[name] for name in ("fx", "fy", "cx", "cy")},
        "width": size_px[0],
        "height": size_px[1],
    }


def main() -> int:
    """Write the export; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shots", type=Path, help="folder of `readygo scene capture --photos`")
    parser.add_argument("--out", type=Path, required=True, help="new folder")
    parser.add_argument("--noise", type=float, default=0.01, help="relative standard deviation of a depth")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()

    def write() -> dict[str, Any]:
        truth = read_truth(truth_path(arguments.shots))
        scene = load_scene(Path(truth.content["scene"]["path"]))
        with unfinished_folder(arguments.out) as folder:
            return {"frames": write_export(arguments.shots, truth, scene, folder, arguments.noise, arguments.seed)}

    return print_row(write, as_json=False)


if __name__ == "__main__":
    sys.exit(main())
