"""How often the driver's camera looks, and how the expert is disturbed; the run's config carries it."""

from dataclasses import dataclass

from readygo.common.errors import ConfigError
from readygo.common.robot import Clock


@dataclass(frozen=True, kw_only=True)
class DriverConfig:
    """The rate of pictures in the drive stage, and how the expert is disturbed there.

    A disturbed expert gives data of states that it would never come to by itself.
    """

    camera_hz: float | None = None
    """How often a picture is taken, the expert is asked what to do and a policy decides [Hz]; in between its command is
    held. What is not drawn leaves time for other places. The rate of the robot's camera divided by a whole number;
    None takes every image of it."""
    disturbed: float = 0.0
    """Share of the expert's episodes in which it is disturbed, 0..1."""
    push: float = 0.5
    """Standard deviation of the pushes, as a multiple of the largest changes of speed and yaw rate that the robot can
    make: what is above 1 it cannot resist."""
    push_time_s: float = 0.5
    """How long a push lasts: the correlation time of an Ornstein-Uhlenbeck process [s]."""
    late_max_s: float = 0.3
    """The robot does now what the expert planned for now this long ago at most; drawn per episode [s]."""

    def image_every(self, clock: Clock) -> int:
        """Steps of a robot's clock from picture to picture.

        Raises:
            ConfigError: If that is no whole number of its camera's images.
        """
        if self.camera_hz is None:
            return clock.image_every
        own_hz = clock.rate_hz / clock.image_every
        if not (0.0 < self.camera_hz <= own_hz and (own_hz / self.camera_hz).is_integer()):
            raise ConfigError(f"camera_hz must be {own_hz:g} Hz divided by a whole number, got {self.camera_hz:g}.")
        return clock.image_every * round(own_hz / self.camera_hz)

    def __post_init__(self) -> None:
        if not 0.0 <= self.disturbed <= 1.0:
            raise ValueError(f"disturbed must be 0..1, got {self.disturbed}.")
        if not (0.0 <= self.push <= 10.0 and 0.05 <= self.push_time_s <= 60.0):
            raise ValueError(f"push must be 0..10 and push_time_s 0.05..60, got {self.push} and {self.push_time_s}.")
        if not 0.0 <= self.late_max_s <= 1.0:
            raise ValueError(f"late_max_s must be 0..1, got {self.late_max_s}.")
