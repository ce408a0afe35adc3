import dataclasses

import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.metric.scale import Scale, marker_side, measure_marker, scale_of_markers
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
    with pytest.raises(SceneError, match=r"contradict each other.*--metric.marker-ids"):
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


def test_more_markers_are_not_known_better_than_the_best_of_them() -> None:
    """Poses of one map are wrong together; the ruler's error is that of all, too."""
    one = measure_marker(IMAGES, sighted(POSES, marker_at(), 0, 0.1), 0.2)
    says = [(1.000, 0.004), (1.009, 0.009), (0.996, 0.006)]
    measures = [
        dataclasses.replace(one, marker=n, metres_per_unit=2.5 * factor, sigma=sigma)
        for n, (factor, sigma) in enumerate(says)
    ]
    scale = scale_of_markers(measures, 0.2, 0.0006)
    assert scale.sigma == pytest.approx(np.hypot(0.004, 0.003))
    weights = [1 / sigma**2 for _, sigma in says]
    mean = np.average(np.log([factor for factor, _ in says]), weights=weights)
    assert scale.metres_per_unit == pytest.approx(2.5 * np.exp(mean))
    assert scale.source == "markers 0, 1, 2 of 0.2 m"
    assert scale_of_markers(measures[:1], 0.2, 0.0).sigma == pytest.approx(0.004)


@pytest.mark.parametrize(("apart", "agree"), [(0.024, True), (0.026, False)])
def test_markers_agree_within_three_sigma_and_one_percent(apart: float, agree: bool) -> None:
    one = dataclasses.replace(measure_marker(IMAGES, sighted(POSES, marker_at(), 0, 0.1), 0.2), sigma=0.003)
    other = dataclasses.replace(one, marker=1, sigma=0.004, metres_per_unit=one.metres_per_unit * np.exp(apart))
    if agree:
        assert scale_of_markers([one, other], 0.2, 0.0).left_out == ()
    else:
        with pytest.raises(SceneError, match="contradict"):
            scale_of_markers([one, other], 0.2, 0.0)


def test_odd_marker_is_named_with_its_difference_and_does_not_count() -> None:
    one = dataclasses.replace(measure_marker(IMAGES, sighted(POSES, marker_at(), 0, 0.1), 0.2), sigma=0.004)
    odd = dataclasses.replace(one, marker=7, sigma=0.001, metres_per_unit=1.25 * one.metres_per_unit)
    scale = scale_of_markers([one, odd, dataclasses.replace(one, marker=2, sigma=0.005)], 0.2, 0.0)
    assert scale.left_out == ("marker 7 says +25.0 %",)
    assert scale.sigma == pytest.approx(0.004)
    assert scale.metres_per_unit == pytest.approx(one.metres_per_unit)


def test_length_of_a_side_and_pixel_noise_give_the_sigma_of_a_marker() -> None:
    """Twice the noise of the corners is twice the sigma, and the residuals are those of the noise."""
    few = [measure_marker(IMAGES, sighted(POSES, marker_at(), n, 0.25), 0.2) for n in range(10)]
    many = [measure_marker(IMAGES, sighted(POSES, marker_at(), n, 0.5), 0.2) for n in range(10)]
    assert np.mean([m.sigma for m in many]) / np.mean([m.sigma for m in few]) == pytest.approx(2.0, rel=0.1)
    errors = [np.log(m.metres_per_unit / TRUE) for m in few]
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) / np.mean([m.sigma for m in few]) < 1.6
    # Of 24 coordinates of a corner three are fitted.
    expected = 0.25 * np.sqrt(2 * 21 / 24)
    assert np.mean([m.residual_px for m in few]) == pytest.approx(expected, rel=0.1)


def test_side_of_a_marker_is_in_units_of_the_map() -> None:
    side = marker_side(IMAGES, sighted(POSES, marker_at((0.2, 0.1, 0.0), 0.15), 0))
    assert side == pytest.approx(0.15 / TRUE)
