import numpy as np
import pytest

from readygo.common.messages import Outcome, RobotTrajectory

COLUMNS = ("human_distance_m", "time_to_collision_s", "expert_cost")


def trajectory(**changes: np.ndarray) -> RobotTrajectory:
    """Twelve steps."""
    arrays = {"xyyaw": np.zeros((12, 3)), "actions": np.zeros((12, 2)), "replan_times_s": np.zeros(4)}
    arrays |= {name: np.zeros(12, np.bool_) for name in ("replanned", "human_visible")}
    arrays |= {name: np.zeros(12) for name in COLUMNS}
    return RobotTrajectory(outcome=Outcome.SUCCESS, **{**arrays, **changes})


def test_every_row_is_one_step_of_a_twentieth_of_a_second() -> None:
    assert trajectory().duration_s == pytest.approx(0.6)


@pytest.mark.parametrize("name", ["actions", "replanned", "human_visible", *COLUMNS])
def test_columns_of_another_length_are_refused(name: str) -> None:
    short = getattr(trajectory(), name)[:-1]
    with pytest.raises(ValueError, match=f"{name} must have shape"):
        trajectory(**{name: short})


def test_flags_must_be_flags() -> None:
    with pytest.raises(ValueError, match=r"replanned must be bool of shape \(12,\), got float64"):
        trajectory(replanned=np.zeros(12))
