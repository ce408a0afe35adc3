"""A robot's rates: how often it is commanded and its camera looks, and the simulated step that follows from both."""

import math
from dataclasses import dataclass

LOWEST_HZ = 20
"""Fewest simulated steps a second, equal to the rows of a human's motion: collisions are only checked at steps."""
HIGHEST_HZ = 120
"""Most simulated steps a second."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Steps of simulation and samples; commands and images come at some of them."""

    rate_hz: int = LOWEST_HZ
    """Steps per second."""
    control_every: int = 1
    """Steps from one command to the next; in between the command is held."""
    image_every: int = 1
    """Steps from one image to the next."""

    @property
    def dt_s(self) -> float:
        """Length of a step [s]."""
        return 1.0 / self.rate_hz

    def time_ns(self, step: int) -> int:
        """Simulated time of a step [ns], rounded down."""
        return step * 1_000_000_000 // self.rate_hz

    def steps(self, time_s: float) -> int:
        """The nearest number of steps to a time [s]."""
        return round(time_s * self.rate_hz)

    def commands(self, step: int) -> bool:
        """True at the steps at which the robot takes a command."""
        return step % self.control_every == 0

    def held_for(self, step: int) -> int:
        """Steps from one on during which the command in force is held."""
        return self.control_every - step % self.control_every

    def sees(self, step: int, late_steps: int) -> bool:
        """True at the steps at which an image comes, taken `late_steps` before; the first one is always there."""
        return step == 0 or (step - late_steps) % self.image_every == 0

    def image_step(self, step: int, late_steps: int) -> int:
        """The step of the newest image that is there at a step; the first one until there is another."""
        return max(step - late_steps, 0) // self.image_every * self.image_every

    def nearest_images(self, time_s: float) -> int:
        """Steps between images that are about a time apart [s], at least from one to the next."""
        return self.image_every * max(1, round(time_s * self.rate_hz / self.image_every))

    def spacing_steps(self, spacing_s: float, *, name: str = "frame_spacing_s") -> int:
        """Steps between images that are `spacing_s` [s] apart.

        Raises:
            ValueError: If that is not a positive multiple of the time between two images.
        """
        images = spacing_s * self.rate_hz / self.image_every
        if not 1 - 1e-6 <= images < math.inf or abs(images - round(images)) > 1e-6:
            raise ValueError(f"{name} must be a multiple of {self.image_every * self.dt_s:g} s, got {spacing_s}.")
        return round(images) * self.image_every


def make_clock(control_hz: int, camera_hz: int) -> Clock:
    """The clock of a robot: the longest step that divides both of its periods and is no longer than 1 / `LOWEST_HZ`.

    Raises:
        ValueError: If there is none of at least 1 / `HIGHEST_HZ`.
    """
    for name, rate_hz in (("control_hz", control_hz), ("camera_hz", camera_hz)):
        if not 1 <= rate_hz <= HIGHEST_HZ:
            raise ValueError(f"{name} must be 1..{HIGHEST_HZ}, got {rate_hz}.")
    common_hz = math.lcm(control_hz, camera_hz)
    rate_hz = common_hz * math.ceil(LOWEST_HZ / common_hz)
    if rate_hz > HIGHEST_HZ:
        raise ValueError(
            f"control_hz {control_hz} and camera_hz {camera_hz} need {rate_hz} steps a second to meet, at most "
            f"{HIGHEST_HZ} are simulated; choose rates like 10, 15, 20, 30 or 60."
        )
    return Clock(rate_hz=rate_hz, control_every=rate_hz // control_hz, image_every=rate_hz // camera_hz)
