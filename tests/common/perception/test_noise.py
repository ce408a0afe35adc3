import pytest

from readygo.common.perception.noise import EXACT, PERCEIVED, PerceptionNoise


def test_correlation_falls_with_time() -> None:
    assert PERCEIVED.correlation_after(0.1) == pytest.approx(0.9)
    assert PERCEIVED.correlation_after(0.2) == pytest.approx(0.81)
    assert PERCEIVED.correlation_after(0.0) == 1.0


def test_exact_perception_measures_velocities_and_never_misses() -> None:
    assert EXACT.measures_velocity
    assert (EXACT.missed, EXACT.bearing_deg, EXACT.distance, EXACT.velocity_mps) == (0.0, 0.0, 0.0, 0.0)


def test_what_is_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match="missed"):
        PerceptionNoise(missed=1.5)
    with pytest.raises(ValueError, match="rate_hz"):
        PerceptionNoise(rate_hz=0.0)
