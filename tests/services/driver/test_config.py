import pytest

from readygo.common.config import section_to_mapping
from readygo.common.errors import ConfigError
from readygo.common.robot import RobotConfig
from readygo.services.driver import DriverConfig


@pytest.mark.parametrize(
    "wrong",
    [{"disturbed": 1.1}, {"disturbed": float("nan")}],
)
def test_what_makes_no_disturbance_is_refused_by_name(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        DriverConfig(**wrong)


def test_nobody_is_disturbed_unless_asked_for() -> None:
    assert DriverConfig().disturbed == 0.0


def test_defaults_are_those_of_the_runs_that_name_none() -> None:
    assert section_to_mapping(DriverConfig()) == {
        "camera_hz": None,
        "disturbed": 0.0,
    }


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [("disturbed", 0.0, 1.0)],
)
def test_limits_are_allowed_and_what_is_beyond_them_is_not(name: str, low: float, high: float) -> None:
    for value in (low, high):
        assert getattr(DriverConfig(**{name: value}), name) == value
    for value in (low - 0.001, high + 0.001):
        with pytest.raises(ValueError, match=name):
            DriverConfig(**{name: value})


def test_pictures_are_taken_at_a_whole_number_of_the_cameras_images() -> None:
    clock = RobotConfig(control_hz=10, camera_hz=30).clock
    slow = RobotConfig(control_hz=20, camera_hz=10).clock
    assert (DriverConfig().image_every(clock), DriverConfig().image_every(slow)) == (1, 2)
    assert [DriverConfig(camera_hz=hz).image_every(clock) for hz in (30.0, 15.0, 10.0, 5.0, 2.5)] == [1, 2, 3, 6, 12]
    assert [DriverConfig(camera_hz=hz).image_every(slow) for hz in (10.0, 5.0, 0.5)] == [2, 4, 40]
    for camera_hz in (0.0, -5.0, 4.0, 20.0):
        with pytest.raises(ConfigError, match="camera_hz must be 10 Hz divided by a whole number"):
            DriverConfig(camera_hz=camera_hz).image_every(slow)
