from pathlib import Path

import cv2
import numpy as np
import pytest

from experiments.reconstruction.device_export import sensor_depths, write_export
from readygo.apps.capture.truth import Truth
from readygo.common.scenes import save_scene
from readygo.services.reconstructor.given.depth import read_depth
from readygo.services.reconstructor.given.find import read_capture
from tests.common.scenes.small_room import small_room
from tests.services.reconstructor.synthetic import looking


def test_depths_have_noise_and_far_ones_low_confidence() -> None:
    depth_m = np.full((100, 100), 2.0, np.float32)
    depth_m[0], depth_m[1] = np.inf, 6.0
    depth_mm, confidence = sensor_depths(depth_m, 0.01, np.random.default_rng(0))
    assert depth_mm[2:].std() == pytest.approx(20.0, rel=0.05)
    assert depth_mm[2:].mean() == pytest.approx(2000.0, abs=1.0)
    assert not depth_mm[0].any()
    assert not confidence[:2].any()
    assert (confidence[2:] == 255).all()


def test_export_is_read_with_its_poses_and_depths(tmp_path: Path) -> None:
    scene = save_scene(small_room(), None, tmp_path / "room")
    T = looking(np.array([2.0, 0.5, 1.2]), np.array([3.0, 2.0, 0.0]))
    lens = {"fx": 120.0, "fy": 120.0, "cx": 81.0, "cy": 59.0, "k1": 0.05, "k2": 0.0, "p1": 0.0, "p2": 0.0}
    frames = [{"image": f"{row}.jpg", "T_world_camera": T.tolist()} for row in range(3)]
    truth = Truth(content={"camera": lens, "width_px": 160, "height_px": 120, "frames": frames})
    for row in range(3):
        (tmp_path / "shots").mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / "shots" / f"{row}.jpg"), np.full((120, 160, 3), 90, np.uint8))
    assert write_export(tmp_path / "shots", truth, scene, tmp_path / "out", 0.0, 0) == 3
    given = read_capture(tmp_path / "out")
    assert given is not None
    assert (given.kind, given.rough) == ("Polycam", False)
    centre = given.T_world_camera[0, :3, 3]
    np.testing.assert_allclose([centre[0], -centre[2], centre[1]], T[:3, 3], atol=1e-12)
    assert given.depth[0] is not None
    depth_m = read_depth(given.depth[0], (160, 120))
    assert depth_m is not None
    # The middle of the lower half shows the floor.
    v, u = 150, 128
    ray = T[:3, :3] @ [((u + 0.5) * 160 / 256 - 81) / 120, ((v + 0.5) * 160 / 256 - 59) / 120, 1.0]
    assert T[2, 3] + depth_m[v, u] * ray[2] == pytest.approx(0.0, abs=0.05)
