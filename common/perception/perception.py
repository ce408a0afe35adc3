"""Perception at run time: images and odometry in, people and free distances out; onnxruntime, one thread."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.camera.config import CameraConfig
from readygo.common.config import section_differences
from readygo.common.errors import PolicyError, first_line
from readygo.common.perception.artifact import FRAMES, GRAPH_FILE, SPEC_FILE, PerceptionSpec, load_perception_spec
from readygo.common.perception.grid import SHAPE
from readygo.common.perception.people import CHANNELS, People, people_of
from readygo.common.policy.memory import PolicyMemory
from readygo.common.policy.onnx_policy import open_session
from readygo.common.robot import RobotConfig


@dataclass(frozen=True, kw_only=True, eq=False)
class Perceived:
    """What one look tells."""

    people: People
    """Humans in the robot's frame."""
    rays_m: Float64Array
    """Free distances from the camera in the directions of the columns (`polar_grid`) [m], shape (C,)."""
    rays_sd: Float64Array
    """Deviations of their logarithms, shape (C,)."""
    answers: Float64Array
    """The map of people as the graph answers it, shape (9, D, C)."""


class Perception:
    """A trained network that perceives; `load_perception` makes it."""

    def __init__(self, spec: PerceptionSpec, session: Any) -> None:
        """Keep the session.

        Args:
            spec: What it was trained for.
            session: onnxruntime's session of the graph.
        """
        self.spec = spec
        """Robot and camera that it was trained with."""
        self._session = session

    def start(self) -> PolicyMemory:
        """Memory for a new episode: tell it of every step or pose, and of every image."""
        clock = self.spec.robot.clock
        late_ns = clock.time_ns(clock.steps(self.spec.robot.camera.latency_s))
        return PolicyMemory(round(self.spec.spacing_s * 1e9), late_ns, FRAMES, clock)

    def perceive(self, memory: PolicyMemory, command: Float32Array) -> Perceived:
        """What the latest images show.

        Args:
            memory: With an image and a pose.
            command: Executed last: v [m/s], w [rad/s], shape (2,).
        """
        frames = [frame.image for frame in memory.window()]
        assert all(frame is not None for frame in frames)
        # As in training, people and rays are seen from where the newest image was taken, also if it comes late.
        motion = memory.own_motion(command, memory.seen_ns)
        return self.look(np.stack(frames), motion)  # type: ignore[arg-type]

    def look(self, frames: UInt8Array, motion: Float32Array) -> Perceived:
        """What some images show.

        Args:
            frames: The oldest first, sRGB, shape (3, H, W, 3).
            motion: See `readygo.common.policy.motion.own_motion`, shape (8,).
        """
        people, rays = self._session.run(["people", "rays"], {"frames": frames, "motion": motion[None]})
        answers = people.astype(np.float64)
        return Perceived(
            people=people_of(answers, self.spec.robot.camera),
            rays_m=rays[0].astype(np.float64),
            rays_sd=rays[1].astype(np.float64),
            answers=answers,
        )


def load_perception(folder: str | Path, *, robot: RobotConfig | None = None) -> Perception:
    """Load perception from its folder.

    Args:
        folder: The folder that training wrote.
        robot: The robot that shall perceive; None skips the comparison of its camera.

    Raises:
        PolicyError: If a file is missing or broken, the format is another version's, the camera differs from
            `robot`'s, or onnxruntime is not installed.
    """
    folder = Path(folder)
    spec = load_perception_spec(folder)
    if robot is not None:
        check_perception_camera(spec.robot.camera, robot.camera)
    perception = Perception(spec, open_session(folder / GRAPH_FILE))
    _check_graph(perception, folder)
    return perception


def check_perception_camera(trained: CameraConfig, camera: CameraConfig) -> None:
    """Raise PolicyError unless a camera is the one that perception was trained with."""
    found = section_differences(trained, camera)
    if found:
        fields = ", ".join(f"{name} {ours} (the robot's: {theirs})" for name, ours, theirs in found)
        raise PolicyError(f"The perception was trained with another camera: {fields}; train it with this one.")


def _check_graph(perception: Perception, folder: Path) -> None:
    camera = perception.spec.robot.camera
    frames = np.zeros((FRAMES, camera.height_px, camera.width_px, 3), np.uint8)
    try:
        perceived = perception.look(frames, np.zeros(3 * (FRAMES - 1) + 2, np.float32))
    except Exception as error:  # onnxruntime raises many unrelated types for a graph of other inputs or shapes
        raise PolicyError(f"The graph of {folder} does not fit its {SPEC_FILE}: {first_line(error)}.") from error
    if perceived.answers.shape != (CHANNELS, *SHAPE) or perceived.rays_m.shape != SHAPE[1:]:
        raise PolicyError(f"The graph of {folder} answers maps of another shape than this version's; train it again.")
