import numpy as np

from readygo.services.reconstructor.metric.markers import MarkerSighting
from readygo.services.reconstructor.poses.tags import GRID, focal_of_tags, tag_features, tag_matches
from tests.services.reconstructor.synthetic import FOCAL_PX, HEIGHT_PX, WIDTH_PX, marker_at, ring, sighted

POSES = ring(6, radius_m=0.8, height_m=0.8)


def test_same_points_of_two_images_match() -> None:
    corners = np.array([[10.0, 10.0], [50.0, 12.0], [48.0, 52.0], [9.0, 49.0]])
    places = [("a", 2, corners), ("b", 2, corners + 7), ("b", 0, corners + 90)]
    seen = [MarkerSighting(image=image, marker=marker, corners_px=px) for image, marker, px in places]
    features = tag_features(seen)
    rows = tag_matches(features["a"][0], features["b"][0])
    assert len(rows) == GRID**2
    np.testing.assert_allclose(features["a"][1][rows[:, 0]] + 7, features["b"][1][rows[:, 1]], atol=1e-3)
    np.testing.assert_allclose(features["a"][1][[0, GRID - 1, -1]], corners[[0, 1, 2]], atol=1e-3)


def test_squares_seen_at_a_slant_tell_the_focal_length() -> None:
    seen = sighted(POSES, marker_at(), 0) + sighted(POSES, marker_at((0.2, 0.1, 0)), 1)
    size = {each.image: (WIDTH_PX, HEIGHT_PX) for each in seen}
    focal_px = focal_of_tags(seen, size)
    assert focal_px is not None
    assert abs(focal_px / FOCAL_PX - 1) < 0.05


def test_few_squares_tell_nothing() -> None:
    assert focal_of_tags(sighted(POSES, marker_at(), 0)[:2], {f"{n:06d}.jpg": (800, 600) for n in range(6)}) is None
