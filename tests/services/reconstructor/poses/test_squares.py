from dataclasses import replace

import numpy as np

from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.poses.squares import adjusted_by_squares
from tests.services.reconstructor.synthetic import floor_points, mapped, marker_at, ring, sighted, some_similarity

CAMERAS = ring(6)
MAP: PosedImages = mapped(CAMERAS, floor_points(20), some_similarity())
SIGHTINGS = [each for m in range(3) for each in sighted(CAMERAS, marker_at((0.4 * m - 0.4, 0.3 * m, 0.0)), m)]


def test_rough_poses_become_those_that_make_markers_squares() -> None:
    rough = MAP.T_world_camera.copy()
    rough[1:, :3, 3] += np.random.default_rng(0).normal(0.0, 0.01, (5, 3))
    poses, focal = adjusted_by_squares(MAP, dict(zip(MAP.names, rough, strict=True)), SIGHTINGS)
    found = np.stack([poses[name] for name in MAP.names])
    assert abs(focal - 1.0) < 1e-3
    # The size of all is that of the rough map; the shape is right.
    true = np.linalg.norm(np.diff(MAP.T_world_camera[:, :3, 3], axis=0), axis=1)
    ways = np.linalg.norm(np.diff(found[:, :3, 3], axis=0), axis=1) / true
    assert np.ptp(ways) < 1e-3
    assert abs(ways.mean() - 1.0) < 0.05


def test_images_without_markers_are_left_out() -> None:
    seen = [each for each in SIGHTINGS if each.image != MAP.names[2]]
    poses, _ = adjusted_by_squares(MAP, dict(zip(MAP.names, MAP.T_world_camera, strict=True)), seen)
    assert set(poses) == set(MAP.names) - {MAP.names[2]}


def test_lens_that_is_known_keeps_its_focal_length() -> None:
    poses = dict(zip(MAP.names, MAP.T_world_camera, strict=True))
    wrong = replace(MAP, rays=lambda view, pixels: 1.1 * MAP.rays(view, pixels))
    assert abs(adjusted_by_squares(wrong, poses, SIGHTINGS)[1] - 1.0) > 0.05
    assert adjusted_by_squares(wrong, poses, SIGHTINGS, fixed_lens=True)[1] == 1.0
