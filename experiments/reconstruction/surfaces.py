"""A reconstructed scene beside the one that was filmed: depths of floor and walls, and where a robot gets.

readygo scene capture SCENE --walk --out out/walk.mp4
readygo reconstruct out/walk.mp4 --marker-size-m 0.2 --out out/lobby
python -m experiments.reconstruction.surfaces out/walk.truth.json out/lobby [--json]

Both scenes are drawn from the cameras of the capture, each from its own pose of them, and depths are compared where the
filmed scene shows level floor or upright wall. The filmed scene, of small Gaussians, has the depth of its median ones.
The found one has that of its Gaussians' planes, which is where the maps have them; "centre" is the depth of the centres
of its median Gaussians: of large flat ones on the floor, these are far from where a ray meets them. Areas are what a
robot of 0.3 m reaches within the part that was filmed, as the found scene's own map has it.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from experiments.reconstruction.rows import print_row
from readygo.apps.capture.truth import Truth, read_truth
from readygo.common.arrays import BoolArray, Float32Array, Float64Array
from readygo.common.camera import CameraConfig
from readygo.common.errors import SceneError
from readygo.common.gaussians import GaussianCloud
from readygo.common.images.images import Images
from readygo.common.maps.distance import clearance_m
from readygo.common.maps.occupancy import OccupancyMap
from readygo.common.rasterizer.interface import View
from readygo.common.robot import RobotConfig
from readygo.common.scenes import Scene, load_scene
from readygo.common.scenes.filmed import FILMED_MIN
from readygo.services.reconstructor.similarity import Similarity, umeyama
from readygo.services.renderer import Renderer, RendererConfig

OUTPUTS = ("rgb", "median_depth", "normal")
HEIGHT_PX, WIDTH_PX, HFOV_DEG = 144, 192, 65.0
LEVEL, UPRIGHT = 0.9, 0.2
"""Cosines to the vertical from and up to which a surface is floor or wall."""
FAR_M = 8.0
DISC_M = 0.3


def measured(truth: Truth, filmed: Scene, found: Scene, every: int) -> dict[str, Any]:
    """Depth errors [m] and areas [m2].

    Raises:
        SceneError: If the found scene has no cameras of this capture.
    """
    poses = dict(zip(found.views.images, found.views.T_world_camera, strict=True)) if found.views else {}
    names = sorted(set(truth.poses) & set(poses))
    if len(names) < 3:
        raise SceneError(f"{found.path} has no cameras of this capture.")
    pairs = [(truth.poses[name], poses[name]) for name in names]
    errors = depth_errors(filmed, found, pairs[::every])
    return {
        "views": len(pairs[::every]),
        **{f"{name}_median_m": round(float(np.median(off)), 4) for name, off in errors.items()},
        **{f"{name}_p90_m": round(float(np.quantile(off, 0.9)), 4) for name, off in errors.items()},
        **areas(filmed, found, rigid(pairs)),
    }


def depth_errors(
    filmed: Scene, found: Scene, pairs: list[tuple[Float64Array, Float64Array]]
) -> dict[str, Float64Array]:
    """Absolute differences of depths [m] at pixels of floor and of walls, over all pairs of poses."""
    off: dict[str, list[Float64Array]] = {name: [] for name in ("floor", "wall", "floor_centre", "wall_centre")}
    camera = CameraConfig(height_px=HEIGHT_PX, width_px=WIDTH_PX, horizontal_fov_deg=HFOV_DEG)
    config = RendererConfig(human_light=False, feet_on_floor=False, outputs=OUTPUTS)
    robot = RobotConfig(camera=camera)
    rasterizers = [Renderer(scene, {}, robot, config).rasterizers[""] for scene in (filmed, found)]
    for there in pairs:
        true, ours = (
            rasterizer.render([View(T_world_camera=T)], OUTPUTS)[0]
            for rasterizer, T in zip(rasterizers, there, strict=True)
        )
        assert ours.median_depth_m is not None
        for kind, depth_m in (("", plane_depths(found.cloud, there[1], camera)), ("_centre", ours.median_depth_m)):
            for name, off_m in off_surfaces(true, there[0], depth_m).items():
                off[name + kind].append(off_m)
    return {name: np.concatenate(parts) for name, parts in off.items()}


def off_surfaces(true: Images, T_world_camera: Float64Array, depth_m: Float32Array) -> dict[str, Float64Array]:
    """How far depths are from those of the filmed scene at its floor and its walls [m].

    Args:
        true: An image of the filmed scene with median depths and normals.
        T_world_camera: Its pose, shape (4, 4).
        depth_m: The other depths, shape (H, W); those that are not finite are left out.
    """
    assert true.normal is not None
    assert true.median_depth_m is not None
    upward = true.normal @ T_world_camera[2, :3]
    known = (true.median_depth_m < FAR_M) & np.isfinite(depth_m)
    shown = {"floor": known & (upward > LEVEL), "wall": known & (np.abs(upward) < UPRIGHT)}
    off_m = np.abs(depth_m - true.median_depth_m)
    return {name: off_m[where].astype(np.float64) for name, where in shown.items()}


def plane_depths(cloud: GaussianCloud, T_world_camera: Float64Array, camera: CameraConfig) -> Float32Array:
    """Depths of a cloud's planes as the training of surfaces has them [m], inf where there are none, shape (H, W)."""
    import torch

    from readygo.services.reconstructor.differentiable.autograd import rasterize
    from readygo.services.reconstructor.training.planes import plane_depth, plane_features, rays_of

    arrays = (cloud.means_m, cloud.quats_wxyz, cloud.scales_m, cloud.opacities)
    means, quats, scales, opacities = (torch.from_numpy(np.ascontiguousarray(array)) for array in arrays)
    T = torch.from_numpy(T_world_camera.astype(np.float32))
    size = (camera.height_px, camera.width_px)
    drawn = rasterize(
        means, quats, scales, opacities, features=plane_features(means, quats, scales, T[:3, 3]),
        T_world_camera=T, K_px=camera.K_px, height_px=size[0], width_px=size[1],
    )  # fmt: skip
    assert drawn.features is not None
    depth_m, known = plane_depth(drawn.features, rays_of(camera.K_px, size) @ T[:3, :3].T)
    return torch.where(known, depth_m, torch.inf).numpy()


def rigid(pairs: list[tuple[Float64Array, Float64Array]]) -> Similarity:
    """The rotation and translation from the found world to the true one."""
    true, ours = (np.array([pair[k][:3, 3] for pair in pairs]) for k in (0, 1))
    R = umeyama(ours, true).R
    return Similarity(scale=1.0, R=R, t=true.mean(axis=0) - R @ ours.mean(axis=0))


def areas(filmed: Scene, found: Scene, to_true: Similarity) -> dict[str, float]:
    """What a robot reaches in either scene within the cells that the found one calls filmed [m2]."""
    ours, true = found.maps.robot, filmed.maps.robot
    share = found.maps.filmed_share
    rows, columns = np.nonzero(np.ones(ours.occupied.shape) if share is None else share >= FILMED_MIN)
    x = ours.frame.origin_x_m + (columns + 0.5) * ours.frame.resolution_m
    y = ours.frame.origin_y_m + (rows + 0.5) * ours.frame.resolution_m
    there = to_true.apply(np.column_stack([x, y, np.zeros(len(x))]))
    i = np.floor((there[:, 1] - true.frame.origin_y_m) / true.frame.resolution_m).astype(int)
    j = np.floor((there[:, 0] - true.frame.origin_x_m) / true.frame.resolution_m).astype(int)
    inside = (i >= 0) & (j >= 0) & (i < true.occupied.shape[0]) & (j < true.occupied.shape[1])
    reached_ours, reached_true = _reached(ours)[rows, columns], np.zeros(len(rows), dtype=bool)
    reached_true[inside] = _reached(true)[i[inside], j[inside]]
    cell = ours.frame.resolution_m**2
    both, either = (reached_ours & reached_true).sum(), (reached_ours | reached_true).sum()
    return {
        "filmed_m2": round(float(len(rows) * cell), 2),
        "reached_m2": round(float(reached_ours.sum() * cell), 2),
        "reached_true_m2": round(float(reached_true.sum() * cell), 2),
        "reached_iou": round(float(both / max(either, 1)), 3),
    }


def _reached(free: OccupancyMap) -> BoolArray:
    """The largest part where a disc of `DISC_M` fits."""
    labels, count = ndimage.label(clearance_m(free) > DISC_M)
    if count == 0:
        return np.zeros(labels.shape, dtype=bool)
    return np.asarray(labels == 1 + int(np.argmax(ndimage.sum(labels > 0, labels, range(1, count + 1)))))


def main() -> int:
    """Print the errors; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth", type=Path, help="NAME.truth.json beside the capture")
    parser.add_argument("scene", type=Path, help="bundle of `readygo reconstruct`")
    parser.add_argument("--filmed", type=Path, help="the scene that was filmed, where it has moved")
    parser.add_argument("--every", type=int, default=3, help="compare each n-th camera")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()

    def measure() -> dict[str, Any]:
        truth = read_truth(arguments.truth)
        filmed = load_scene(arguments.filmed or Path(truth.content["scene"]["path"]))
        return measured(truth, filmed, load_scene(arguments.scene), arguments.every)

    return print_row(measure, as_json=arguments.json)


if __name__ == "__main__":
    sys.exit(main())
