from dataclasses import replace

import numpy as np
import pytest

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.camera.lens import make_lens
from readygo.common.images.light import byte_of_light, light_of_byte
from readygo.services.renderer import RendererConfig
from readygo.services.renderer.camera import TIME_ONE
from readygo.services.renderer.config import sensor_phone_like
from readygo.services.renderer.faces import (
    OVERSAMPLING,
    R_FACE_CAMERA,
    WEIGHT_ONE,
    Faces,
    make_remap,
    plan_faces,
)
from readygo.services.renderer.light import add_light, to_srgb

CAMERA = CameraConfig(height_px=72, width_px=128)
WIDE = replace(CAMERA, distortion="fisheye", k1=0.02, horizontal_fov_deg=145.0)
CASES = [replace(CAMERA, distortion="brown_conrady", k1=-0.05, p1=0.002), replace(CAMERA, distortion="fisheye"), WIDE]


def directions(faces: Faces, face: int) -> np.ndarray:
    """Unit vectors in the camera's frame that the pixels of a face see, shape (Hf, Wf, 3)."""
    u, v = np.meshgrid(np.arange(faces.width_px) + 0.5, np.arange(faces.height_px) + 0.5)
    rays = np.stack([(u - faces.cx_px) / faces.focal_px, (v - faces.cy_px) / faces.focal_px, np.ones_like(u)], axis=-1)
    rays = rays @ R_FACE_CAMERA[face]
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def lens_directions(lens) -> np.ndarray:
    u, v = np.meshgrid(np.arange(lens.width_px) + 0.5, np.arange(lens.height_px) + 0.5)
    xy = lens.rays(np.stack([u, v], axis=-1).reshape(-1, 2)).reshape(lens.height_px, lens.width_px, 2)
    rays = np.concatenate([xy, np.ones((*xy.shape[:2], 1))], axis=-1)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


@pytest.mark.parametrize("camera", CASES)
def test_smooth_world_is_seen_through_the_lens(camera: CameraConfig) -> None:
    lens = make_lens(camera)
    faces = plan_faces([lens])
    remap = make_remap(lens, faces)

    def light(rays: np.ndarray) -> np.ndarray:
        return 0.5 + 0.4 * np.sin(3.0 * rays + (0.3, 1.0, 2.0))

    images = np.stack([byte_of_light()[np.rint(light(directions(faces, k)) * 65535).astype(int)] for k in remap.faces])
    total = np.zeros((camera.height_px, camera.width_px, 3), np.int64)
    add_light(total, images, remap, np.full(camera.height_px, TIME_ONE, dtype=np.int64))
    seen = to_srgb(total, CameraConfig(), np.ones((camera.height_px, camera.width_px)), np.random.default_rng(0))
    assert np.abs(light_of_byte()[seen] / 65535 - light(lens_directions(lens))).max() < 0.01


@pytest.mark.parametrize("camera", CASES)
def test_nearest_source_is_within_a_pixel_of_the_ray(camera: CameraConfig) -> None:
    lens = make_lens(camera)
    faces = plan_faces([lens])
    remap = make_remap(lens, faces)
    table = np.stack([directions(faces, face) for face in remap.faces]).reshape(-1, 3)
    expected = lens_directions(lens)
    angle = np.arccos(np.clip((table[remap.nearest] * expected).sum(axis=-1), -1, 1))
    assert angle.max() < 1.0 / faces.focal_px
    along_face = np.einsum("hwk,hwk->hw", R_FACE_CAMERA[list(remap.faces)][remap.face][:, :, 2], expected)
    assert remap.depth_factor == pytest.approx(expected[..., 2] / along_face)


@pytest.mark.parametrize("camera", CASES)
def test_weights_are_whole_and_no_source_is_at_the_faces_edge(camera: CameraConfig) -> None:
    lens = make_lens(camera)
    faces = plan_faces([lens])
    remap = make_remap(lens, faces)
    assert (np.add.reduceat(remap.weight, remap.start[:-1]) == WEIGHT_ONE).all()
    line, column = np.divmod(remap.source % (faces.height_px * faces.width_px), faces.width_px)
    assert 0 < column.min() < column.max() < faces.width_px - 1
    assert 0 < line.min() < line.max() < faces.height_px - 1


def test_faces_are_finer_than_the_image_everywhere_and_a_cube_only_where_needed() -> None:
    for camera in CASES:
        lens = make_lens(camera)
        faces = plan_faces([lens])
        remap = make_remap(lens, faces)
        assert faces.cube == (camera is WIDE)
        assert remap.faces == ((0, 1, 2) if camera is WIDE else (0,))
        turned = np.einsum("hwik,hwk->hwi", R_FACE_CAMERA[list(remap.faces)][remap.face], lens_directions(lens))
        uv = faces.focal_px * turned[..., :2] / turned[..., 2:]
        for axis in (0, 1):
            together = np.diff(remap.face, axis=axis) == 0
            assert np.linalg.norm(np.diff(uv, axis=axis), axis=-1)[together].min() > 0.98 * OVERSAMPLING


def test_plan_for_ranges_holds_every_lens_between_them() -> None:
    phone, config = sensor_phone_like(CAMERA, RendererConfig())
    faces = plan_faces([make_lens(extreme) for extreme in config.sensor.extremes(phone)])
    for seed in range(12):
        remap = make_remap(make_lens(config.sensor.draw_camera(phone, np.random.default_rng(seed))), faces)
        line, column = np.divmod(remap.source, faces.width_px)
        assert 0 < column.min() < column.max() < faces.width_px - 1
        assert 0 < line.min() < line.max() < faces.height_px - 1


def test_remap_of_no_distortion_is_an_upright_image() -> None:
    straight = replace(CAMERA, distortion="brown_conrady")
    faces = plan_faces([make_lens(extreme) for extreme in SensorConfig(k1=(-0.02, 0.02)).extremes(straight)])
    remap = make_remap(make_lens(straight), faces)
    line, column = np.divmod(remap.nearest, faces.width_px)
    assert (np.diff(column, axis=1) > 0).all()
    assert (np.diff(line, axis=0) > 0).all()
    assert (column == column[:1]).all()
    assert (remap.depth_factor == 1.0).all()


@pytest.mark.parametrize("camera", CASES)
def test_depth_of_a_face_becomes_depth_along_the_cameras_axis(camera: CameraConfig) -> None:
    lens = make_lens(camera)
    remap = make_remap(lens, plan_faces([lens]))
    points_m = 7.0 * lens_directions(lens)
    R = R_FACE_CAMERA[np.array(remap.faces)[remap.face]]
    depth_of_face_m = np.einsum("vuk,vuk->vu", R[:, :, 2], points_m)
    assert depth_of_face_m.min() > 0
    assert remap.depth_factor * depth_of_face_m == pytest.approx(points_m[..., 2], rel=1e-9)
    assert (len(remap.faces) > 1) == (camera is WIDE)


@pytest.mark.parametrize("number", range(4))
def test_way_through_a_lens_is_as_it_was(number, golden_figures) -> None:
    crooked = CameraConfig(
        height_px=41, width_px=67, fx_px=44.0, fy_px=47.0, cx_px=30.5, cy_px=22.25, distortion="brown_conrady",
        k1=-0.03, k2=0.004, p1=0.002, p2=-0.003,
    )  # fmt: skip
    lens = make_lens([replace(case, height_px=41, width_px=67) for case in CASES][number] if number < 3 else crooked)
    faces = plan_faces([lens])
    remap = make_remap(lens, faces)
    golden_figures(
        f"sensor/faces {number}", [[faces.focal_px, faces.cx_px, faces.cy_px, *faces.K_px.ravel()]], scale=0.1
    )
    sizes = [faces.height_px, faces.width_px, len(remap.faces), len(remap.source)]
    golden_figures(f"sensor/face sizes {number}", sizes, scale=0.1)
    golden_figures(f"sensor/sources {number}", remap.source, remap.weight, scale=1e-2)
    golden_figures(f"sensor/nearest {number}", remap.nearest.ravel(), remap.face.ravel(), scale=1e-2)
    golden_figures(f"sensor/depth factors {number}", remap.depth_factor.ravel(), np.diff(remap.start))
