import math

import pytest

from readygo.apps.drive.messages import (
    STAMP_MAX_NS,
    GoalMessage,
    ImageMessage,
    OdometryMessage,
    Value,
    VelocityMessage,
    check_numbers,
)
from readygo.apps.robot_logs.reader import NUMBER_MAX, LogCamera


def _camera(number: float) -> LogCamera:
    return LogCamera(height_px=4, width_px=6, K_px=(number,) * 9, model="", distortion=())


def _odometry(number: float) -> OdometryMessage:
    return OdometryMessage(stamp_ns=7, x_m=0.0, y_m=number, yaw_rad=0.0, v_mps=0.0, w_radps=0.0)


@pytest.mark.parametrize("number", [math.nan, math.inf, -2 * NUMBER_MAX])
def test_numbers_that_no_robot_means_are_refused(number: float) -> None:
    values: list[Value] = [
        _odometry(number),
        VelocityMessage(w_radps=number),
        GoalMessage(x_m=number, y_m=0.0),
        _camera(number),
    ]
    for value in values:
        with pytest.raises(ValueError, match="it must be finite"):
            check_numbers(value)


@pytest.mark.parametrize(
    "value", [_odometry(NUMBER_MAX), VelocityMessage(), GoalMessage(x_m=-1.0, y_m=2.0), _camera(5.0), "success"]
)
def test_what_a_robot_means_comes_back(value: Value) -> None:
    assert check_numbers(value) is value


@pytest.mark.parametrize("stamp_ns", [-1, STAMP_MAX_NS])
def test_times_that_are_none_are_refused(stamp_ns: int) -> None:
    with pytest.raises(ValueError, match="its time is"):
        check_numbers(ImageMessage(stamp_ns=stamp_ns, decode=lambda: 0))  # type: ignore[arg-type, return-value]
