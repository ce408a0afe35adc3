import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.metric.scale import Scale, measure_marker, scale_of_markers
from tests.services.reconstructor.synthetic import floor_points, mapped, marker_at, ring, sighted, some_similarity

POSES = ring()
IMAGES = mapped(POSES, floor_points(30), some_similarity())
TRUE = 1.0 / some_similarity().scale


def test_exact_corners_give_the_exact_scale() -> None:
    measure = measure_marker(IMAGES, sighted(POSES, marker_at(), 3), 0.2)
    np.testing.assert_allclose(measure.metres_per_unit, TRUE, rtol=1e-7)
    assert measure.views == 12


def test_interval_holds_the_truth_for_noisy_corners() -> None:
    within = []
    for marker in range(8):
        measure = measure_marker(IMAGES, sighted(POSES, marker_at(), marker, noise_px=0.3), 0.2)
        scale = scale_of_markers([measure], 0.2, 0.0)
        low, high = scale.interval
        within.append(low <= TRUE <= high)
        assert 0.0002 < measure.sigma < 0.01
    assert sum(within) >= 6


def test_two_markers_that_contradict_each_other_are_refused() -> None:
    a = measure_marker(IMAGES, sighted(POSES, marker_at(), 0, 0.1), 0.2)
    b = measure_marker(IMAGES, sighted(POSES, marker_at((0.5, 0, 0), 0.15), 1, 0.1), 0.2)
    with pytest.raises(SceneError, match=r"contradict each other.*--marker-id"):
        scale_of_markers([a, b], 0.2, 0.0002)


def test_of_three_markers_the_odd_one_is_named_and_left_out() -> None:
    places = [((0, 0, 0), 0.2), ((0.5, 0, 0), 0.15), ((0, 0.5, 0), 0.2)]
    measures = [measure_marker(IMAGES, sighted(POSES, marker_at(*p), n, 0.1), 0.2) for n, p in enumerate(places)]
    scale = scale_of_markers(measures, 0.2, 0.0002)
    np.testing.assert_allclose(scale.metres_per_unit, TRUE, rtol=3e-3)
    assert len(scale.left_out) == 1
    assert scale.left_out[0].startswith("marker 1 ")


def test_marker_that_moved_is_refused() -> None:
    seen = sighted(POSES[:6], marker_at(), 0) + sighted(POSES, marker_at((0.4, 0.3, 0)), 0)[6:]
    with pytest.raises(SceneError, match=r"no square|only"):
        measure_marker(IMAGES, seen, 0.2)


def test_marker_in_two_images_is_refused() -> None:
    with pytest.raises(SceneError, match="2 images with a pose; 3 are needed"):
        measure_marker(IMAGES, sighted(POSES, marker_at(), 0)[:2], 0.2)


def test_interval_holds_both_the_rulers_error_and_the_drift() -> None:
    low, high = Scale(metres_per_unit=2.0, sigma=0.003, drift=0.004, source="").interval
    np.testing.assert_allclose([low, high], [2.0 * (1 - 1.96 * 0.005), 2.0 * (1 + 1.96 * 0.005)])
