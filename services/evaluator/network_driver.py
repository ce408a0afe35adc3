"""Drives by a published network: four times a second it looks, and steers at one of the predicted waypoints.

The goal is an image of what the robot would see there without humans. Success is judged by the distance, as for all
other methods: the networks' own estimate of arrival is not used.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from readygo.common.arrays import UInt8Array
from readygo.common.episode import EpisodeSimulation, Purpose, episode_rng
from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.errors import PolicyError
from readygo.common.extras import install_command
from readygo.common.networks import LOOK_HZ
from readygo.common.robot import RobotConfig
from readygo.services.evaluator.eyes import Eyes
from readygo.services.evaluator.handlers import Evaluator

WAYPOINT = 2
"""Index of the predicted waypoint that the robot steers at."""


@dataclass
class NetworkState:
    """State of one episode."""

    goal: Any
    """The goal's image, a tensor of shape (3, h, w)."""
    generator: Any
    """Random generator of NoMaD's samples."""
    frames: list[Any] = field(default_factory=list)
    """The latest images, oldest first."""
    command: tuple[float, float] = (0.0, 0.0)


class NetworkDriver:
    """Drives by GNM, ViNT or NoMaD."""

    looks = True

    def __init__(self, network: Any, eyes: Eyes) -> None:
        self._network, self._eyes = network, eyes

    @classmethod
    def load(cls, name: str, path: Path, evaluator: Evaluator) -> "NetworkDriver":
        """A network with the weights of a file.

        Raises:
            PolicyError: If torch or the file is missing, or the file cannot be used.
        """
        try:
            from readygo.common.networks.checkpoint import load_network
        except ImportError as error:
            raise PolicyError(f"The method {name} needs torch; run: {install_command('train')}") from error
        return cls(load_network(name, path), evaluator.eyes())

    def start(self, simulation: EpisodeSimulation) -> NetworkState:
        """Look at the goal from where the robot would arrive."""
        import torch

        image = self._eyes.goal_image(simulation)
        seed = int(episode_rng(simulation.scenario.episode, Purpose.DRIVER).integers(2**31))
        return NetworkState(goal=self._prepare_image(image), generator=torch.Generator().manual_seed(seed))

    def act(self, running: Sequence[tuple[EpisodeSimulation, NetworkState]]) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        due = [(at, state) for at, state in running if at.step % at.clock.nearest_images(1.0 / LOOK_HZ) == 0]
        if due:
            images = self._eyes.look([simulation for simulation, _ in due])
            for (simulation, state), image in zip(due, images, strict=True):
                self._decide(state, image, simulation.robot)
        return [state.command for _, state in running]

    def _decide(self, state: NetworkState, image: UInt8Array, robot: RobotConfig) -> None:
        import torch

        frame, count = self._prepare_image(image), self._network.frames
        state.frames = [*(state.frames or [frame] * (count - 1)), frame][-count:]
        with torch.inference_mode():
            places = self._network.waypoints(torch.stack(state.frames)[None], state.goal[None], state.generator)
        waypoint = places[0, WAYPOINT].tolist()
        unit_m = robot.v_max_mps / LOOK_HZ
        state.command = steer((waypoint[0] * unit_m, waypoint[1] * unit_m, *waypoint[2:]), robot)

    def _prepare_image(self, image: UInt8Array) -> Any:
        """An image as the networks know them, shape (3, h, w)."""
        from readygo.common.networks.images import normalise_images, small_image

        return normalise_images(small_image(image, self._network.width_px, self._network.height_px))


def steer(waypoint: Sequence[float], robot: RobotConfig) -> tuple[float, float]:
    """The command that leads to a waypoint within the time between two looks, as the networks' own controller has it.

    Args:
        waypoint: x forward and y left [m], and, optionally, the cosine and sine of the heading there.
        robot: Limits.

    Returns:
        v [m/s] and w [rad/s]. A place behind the robot is steered at as its mirror image in front.

    Source: the networks' published deployment (PD controller).
    """
    dx, dy = waypoint[:2]
    if abs(dx) < 1e-8 and abs(dy) < 1e-8 and len(waypoint) == 4:
        v, w = 0.0, math.atan2(waypoint[3], waypoint[2]) * LOOK_HZ
    elif abs(dx) < 1e-8:
        v, w = 0.0, math.copysign(math.pi / 2, dy) * LOOK_HZ
    else:
        v, w = dx * LOOK_HZ, math.atan(dy / dx) * LOOK_HZ
    return min(max(v, 0.0), robot.v_max_mps), min(max(w, -robot.w_max_radps), robot.w_max_radps)
