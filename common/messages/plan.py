"""What a robot did in an episode, and how it ended."""

import enum
from dataclasses import dataclass, field

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.messages.checks import check_array
from readygo.common.messages.codec import OMITTED_WHEN_DEFAULT
from readygo.common.robot.kinematics import RATE_HZ


class Outcome(enum.Enum):
    """How an episode ended."""

    SUCCESS = "success"
    STATIC_COLLISION = "static_collision"
    HUMAN_COLLISION = "human_collision"
    TIMEOUT = "timeout"


class DriverKind(enum.Enum):
    """Driver of the robot in a recorded episode."""

    EXPERT = "expert"
    POLICY = "policy"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RobotTrajectory:
    """A robot's closed-loop run: T samples at `rate_hz`, from the start to the end of the episode."""

    outcome: Outcome
    xyyaw: Float64Array
    """Pose at each sample's time: x [m], y [m], yaw [rad] (not wrapped), shape (T, 3)."""
    actions: Float64Array
    """Command executed over the next dt: v [m/s], w [rad/s], shape (T, 2)."""
    replanned: BoolArray
    """True where the expert replanned at this step, shape (T,)."""
    human_visible: BoolArray
    """True where the robot perceives a human (field of view and range), shape (T,)."""
    human_distance_m: Float64Array
    """Distance of the centres of robot and nearest human [m], inf without humans, shape (T,)."""
    time_to_collision_s: Float64Array
    """Time until the discs of robot and some human touch at constant velocities [s], inf if never, shape (T,)."""
    expert_cost: Float64Array
    """Cost of the plan in force, shape (T,)."""
    replan_times_s: Float64Array
    """CPU time of each replan [s], shape (R,); not part of the recorded samples."""
    rate_hz: int = field(default=RATE_HZ, metadata=OMITTED_WHEN_DEFAULT)
    """Samples per second: the steps of the robot's clock."""

    def __post_init__(self) -> None:
        count = len(self.xyyaw)
        check_array("xyyaw", self.xyyaw, np.float64, (None, 3))
        check_array("actions", self.actions, np.float64, (count, 2))
        for name in ("replanned", "human_visible"):
            check_array(name, getattr(self, name), np.bool_, (count,))
        for name in ("human_distance_m", "time_to_collision_s", "expert_cost"):
            check_array(name, getattr(self, name), np.float64, (count,))

    @property
    def dt_s(self) -> float:
        """Time between two samples [s]."""
        return 1.0 / self.rate_hz

    @property
    def duration_s(self) -> float:
        """Simulated time until the episode ended [s]."""
        return len(self.xyyaw) * self.dt_s
