"""What a run publishes while it continues; docs/live.md is the page for programs that subscribe.

All of it is lossy, none of it is recorded, and a process makes a message only while a subscriber listens.
"""

from dataclasses import dataclass, field

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array
from readygo.common.messages.checks import check_array, check_printable, check_sha256
from readygo.common.messages.codec import OMITTED_WHEN_DEFAULT
from readygo.common.messages.episode import EpisodeKey
from readygo.common.messages.plan import DriverKind, Outcome


@dataclass(frozen=True, kw_only=True, slots=True)
class LivePreview:
    """The newest images of an episode that is being made."""

    episode: EpisodeKey
    time_ns: int
    """Simulated time since the episode began [ns]."""
    format: str
    """Encoding of the images: "jpeg" or "png"."""
    image: bytes
    """Image of the first camera, encoded."""
    outputs: dict[str, bytes] = field(default_factory=dict, hash=False, metadata=OMITTED_WHEN_DEFAULT)
    """Those of the other cameras, in the same format, and depths, as PNG, by their names
    (`readygo.common.images.names`)."""


@dataclass(frozen=True, kw_only=True, slots=True)
class LiveState:
    """Where everybody is in an episode that is being made."""

    episode: EpisodeKey
    time_ns: int
    """Simulated time since the episode began [ns]."""
    sample: int
    sample_count: int
    driver: DriverKind
    goal_xy_m: tuple[float, float]
    """Goal in the world: x, y [m]."""
    robot_xyzyaw: tuple[float, float, float, float]
    """Robot on the floor: x, y, z [m], yaw [rad]."""
    v_mps: float
    w_radps: float
    humans_xyzyaw: tuple[tuple[float, float, float, float], ...]
    """Humans on the floor: x, y, z [m], yaw [rad]."""
    human_visible: bool
    human_distance_m: float
    """Distance to the nearest human [m]; infinite without humans."""
    time_to_collision_s: float
    replanned: bool
    horizontal_fov_rad: float
    """Horizontal field of view of the robot's camera [rad]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class LivePerson:
    """A human that a driver perceives, in the world."""

    number: int
    """Number of the track, or of the detection in its image."""
    presence: float
    """Probability that there is a human, 0..1."""
    xy_m: tuple[float, float]
    """Place on the floor [m]."""
    v_mps: tuple[float, float]
    """Velocity over the ground [m/s]."""
    place_cov_m2: tuple[float, float, float]
    """Covariance of the place: xx, xy, yy [m2]."""
    velocity_cov_m2ps2: tuple[float, float, float]
    """Covariance of the velocity: xx, xy, yy [m2/s2]."""
    age_s: float = 0.0
    """Time since the latest detection [s]."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LivePerception:
    """What a driver perceives in its robot's images: people, their tracks over time, and free distances."""

    episode: EpisodeKey
    time_ns: int
    """Simulated time of the look since the episode began [ns]."""
    robot_xyzyaw: tuple[float, float, float, float]
    """Robot on the floor when the image was taken: x, y, z [m], yaw [rad]."""
    detections: tuple[LivePerson, ...]
    """Humans in this image, the likeliest first."""
    tracks: tuple[LivePerson, ...]
    """Humans over time, also those that are hidden at present."""
    ray_bearings_rad: Float32Array
    """Directions of the free distances from the camera's heading to the left [rad], shape (C,)."""
    rays_m: Float32Array
    """Free distances from the camera over the floor [m], shape (C,)."""

    def __post_init__(self) -> None:
        check_array("ray_bearings_rad", self.ray_bearings_rad, np.float32, (None,))
        check_array("rays_m", self.rays_m, np.float32, (len(self.ray_bearings_rad),))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LivePlan:
    """What the expert planned for an episode."""

    episode: EpisodeKey
    outcome: Outcome
    goal_xy_m: tuple[float, float]
    robot_xyyaw: Float32Array
    """Way of the robot, five poses a second: x, y [m], yaw [rad], shape (T, 3)."""
    replanned: BoolArray
    """True where the expert replanned since the pose before, shape (T,)."""
    humans_xy_m: tuple[Float32Array, ...]
    """Ways of the humans, five points a second, shape (T_h, 2) each; they stand at the last one."""

    def __post_init__(self) -> None:
        check_array("robot_xyyaw", self.robot_xyyaw, np.float32, (None, 3))
        check_array("replanned", self.replanned, np.bool_, (len(self.robot_xyyaw),))
        for way in self.humans_xy_m:
            check_array("humans_xy_m", way, np.float32, (None, 2))


@dataclass(frozen=True, kw_only=True, slots=True)
class LiveWork:
    """What a worker does, said when it begins or ends it."""

    stage: str
    episode: EpisodeKey
    attempt: int
    begins: bool
    cpu_s: float
    """CPU time of its process so far [s]."""
    memory_bytes: int
    """Memory of its process, at most so far."""
    rejected: str = ""
    """Why the stage rejected the episode."""
    failed: str = ""
    """The worker's error."""

    def __post_init__(self) -> None:
        check_printable("stage", self.stage)


@dataclass(frozen=True, kw_only=True, slots=True)
class LiveHealth:
    """What a process takes of its machine, about once a second."""

    role: str
    name: str
    host: str
    pid: int
    uptime_s: float
    """Time of its machine, from any beginning [s]."""
    cpu_s: float
    """CPU time of the process so far [s]."""
    memory_bytes: int
    """Memory that only this process holds [bytes]."""
    disk_free_bytes: int
    """Room on the disk of its data; 0 without any."""
    disk_size_bytes: int
    metrics: str
    """Endpoint of its metrics, HOST:PORT; empty if there is none."""

    def __post_init__(self) -> None:
        check_printable("role", self.role)
        check_printable("name", self.name)
        check_printable("host", self.host, empty=True)
        check_printable("metrics", self.metrics, empty=True)


@dataclass(frozen=True, kw_only=True, slots=True)
class LiveCommit:
    """An episode that is durable now; its samples are on `train/episodes`."""

    episode: EpisodeKey
    attempt: int
    outcome: Outcome
    driver: DriverKind
    policy: str
    """SHA-256 of the offered policy that drove, as in `EpisodeHeader.policy`; empty if it was none."""
    sample_count: int
    shard: str

    def __post_init__(self) -> None:
        check_printable("shard", self.shard)
        check_sha256("policy", self.policy, empty=True)


@dataclass(frozen=True, kw_only=True, slots=True)
class LiveLoss:
    """How far a trainer is, as the last entry of its history has it."""

    steps: int
    samples: int
    """Samples learned from so far."""
    train_loss: float
    validation_loss: float
    """Loss on held-out episodes."""
    success_rate: float | None = None
    """Success rate in closed loop, 0..1, where it was measured."""


@dataclass(frozen=True, kw_only=True, slots=True)
class LiveEvaluation:
    """How an episode of an evaluation ended."""

    episode: EpisodeKey
    task: str
    """"static" or "dynamic": without humans or among them."""
    method: str
    """Method that drove: "policy", or the name of a baseline."""
    policy: str
    """SHA-256 over the files of the policy that is measured; empty for a baseline."""
    outcome: Outcome
    duration_s: float
    """Simulated time until the episode ended [s]."""

    def __post_init__(self) -> None:
        check_printable("task", self.task)
        check_printable("method", self.method)
        check_sha256("policy", self.policy, empty=True)
