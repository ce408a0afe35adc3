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
