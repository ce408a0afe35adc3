import json

import numpy as np
import pytest

from readygo.common.camera.captured import CapturedViews
from readygo.common.camera.written import colmap_texts, transforms_text
from readygo.common.errors import SceneError
from readygo.common.frames import matrix_from_axis_angle, matrix_from_quat

POINT = np.array([0.4, -0.3, 2.5])


def views(names=("a.jpg", "b/c.jpg", "d.jpg")):
    T = np.tile(np.eye(4), (3, 1, 1))
    for k in range(3):
        T[k, :3, :3], T[k, :3, 3] = matrix_from_axis_angle([0.1 * k, -0.2, 0.05]), [0.1, 0.2 * k, -1.0]
    K = np.tile([[500.0, 0, 320.25], [0, 510.0, 239.5], [0, 0, 1.0]], (3, 1, 1))
    K[2, 0, 0] = 400.125
    return CapturedViews(images=names, sizes_px=np.tile([640, 480], (3, 1)), K_px=K, T_world_camera=T)


def pixel(views, row):
    T = views.T_world_camera[row]
    p = views.K_px[row] @ (T[:3, :3].T @ (POINT - T[:3, 3]))
    return p[:2] / p[2]


def test_colmap_text_shows_a_point_at_its_pixel_and_shares_lenses():
    texts = colmap_texts(views(), np.array([[1.0, 2.5, -3.0]]), np.array([[1, 2, 255]], np.uint8))
    cameras = {int(line.split()[0]): line.split()[1:] for line in texts["cameras.txt"].splitlines()}
    assert [row[:3] for row in cameras.values()] == [["PINHOLE", "640", "480"]] * 2
    lines = texts["images.txt"].splitlines()
    assert lines[1::2] == ["", "", ""]
    for row, line in enumerate(lines[::2]):
        words = line.split()
        q, t, lens = (
            np.array(words[1:5], float),
            np.array(words[5:8], float),
            np.array(cameras[int(words[8])][3:], float),
        )
        x, y, z = matrix_from_quat(q) @ POINT + t
        seen = lens[0] * x / z + lens[2], lens[1] * y / z + lens[3]
        np.testing.assert_allclose(seen, pixel(views(), row), atol=1e-9)
        assert words[9] == views().images[row]
    assert texts["points3D.txt"] == "1 1 2.5 -3 1 2 255 0\n"


def test_names_with_spaces_are_refused_for_colmap():
    with pytest.raises(SceneError, match=r"'my b\.jpg'"):
        colmap_texts(views(("a.jpg", "my b.jpg", "c.jpg")), np.empty((0, 3)), np.empty((0, 3), np.uint8))


def test_transforms_show_a_point_at_its_pixel():
    table = json.loads(transforms_text(views()))
    for row, frame in enumerate(table["frames"]):
        T = np.array(frame["transform_matrix"])
        right, up, backward = T[:3, :3].T @ (POINT - T[:3, 3])
        seen = (
            frame["cx"] + frame["fl_x"] * right / -backward,
            frame["cy"] - frame["fl_y"] * up / -backward,
        )
        np.testing.assert_allclose(seen, pixel(views(), row), atol=1e-9)
    assert table["frames"][1]["file_path"] == "images/b/c.jpg"
