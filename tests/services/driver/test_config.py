import pytest

from readygo.services.driver import DriverConfig


@pytest.mark.parametrize(
    "wrong",
    [{"disturbed": 1.1}, {"disturbed": float("nan")}, {"push": -0.1}, {"push_time_s": 0.0}, {"late_max_s": 1.5}],
)
def test_what_makes_no_disturbance_is_refused_by_name(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        DriverConfig(**wrong)


def test_nobody_is_disturbed_unless_asked_for() -> None:
    assert DriverConfig().disturbed == 0.0
