"""The real furnished flat with a real human in it."""

import math
from pathlib import Path

import numpy as np

from readygo.common.avatars import load_avatar, pose_avatar
from readygo.common.gaussians import concatenate, load_gaussians
from readygo.common.images.images import OUTPUTS
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman
from readygo.common.rasterizer.packed.scene import pack_cloud
from readygo.common.rasterizer.reference import rasterize_reference
from readygo.common.robot import CameraConfig
from tests.common.rasterizer.drawing import float_rgb_of, images_of, numbered


def test_showroom_with_a_human_looks_as_in_the_reference(shared_data: Path) -> None:
    scene = load_gaussians(shared_data / "scenes" / "showroom.compressed.ply")
    sky = load_gaussians(shared_data / "scenes" / "showroom_env.compressed.ply")
    avatar = load_avatar(shared_data / "avatars" / "m1_casual.npz")
    motion = np.load(shared_data / "motion" / "walk_s_curve_1p2mps.npz")
    root = motion["root_m"][40].copy()
    root[:2] = (1.8, 0.4)
    human = PosedHuman(avatar="0", root_m=root, pose_axis_angle=motion["pose_axis_angle"][40])
    camera = CameraConfig()
    T = camera.T_world_camera(0.0, 0.0, 0.0, 0.0)
    layers = [pack_cloud(scene, normals=True), pack_cloud(sky, normals=True)]
    rasterizer = CpuRasterizer(layers, numbered([avatar]), camera.K_px, 144, 256)
    image = float_rgb_of(rasterizer, T, [human])
    others = images_of(rasterizer, T, [human], OUTPUTS)
    body = pose_avatar(avatar, root, human.pose_axis_angle)
    instances = np.repeat([0, 1], [len(scene) + len(sky), len(body)])
    reference = rasterize_reference(concatenate([scene, sky, body]), T, camera.K_px, 144, 256, instances=instances)
    error = np.abs(image - reference.rgb).max(axis=2)
    assert -10 * math.log10(float(((image.astype(np.float64) - reference.rgb) ** 2).mean())) > 50
    # The file's quantised coordinates give some Gaussians exactly equal depths, whose order is open.
    assert (error > 2 / 255).mean() < 0.005
    assert np.bincount(reference.mask.ravel(), minlength=2).min() > 1000
    assert (others.mask != reference.mask).mean() < 0.0005
    for name in ("depth_m", "median_depth_m"):
        assert (~np.isclose(getattr(others, name), getattr(reference, name), rtol=2e-3)).mean() < 0.0005
    assert (np.linalg.norm(others.normal - reference.normal, axis=2) > 0.05).mean() < 0.005
