"""Recorded samples on their way from a renderer to a recorder."""

import enum
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.messages.checks import check_array, check_sha256
from readygo.common.messages.codec import OMITTED_WHEN_DEFAULT
from readygo.common.messages.episode import EpisodeKey
from readygo.common.messages.plan import DriverKind, Outcome

DISTORTION_MODELS: Mapping[str, int] = {"": 0, "plumb_bob": 5, "rational_polynomial": 8, "kannala_brandt": 4}
"""Models of a lens and the number of their coefficients, by the names that ROS and Foxglove use.

"" is an ideal pinhole camera; "plumb_bob" is Brown-Conrady (k1, k2, p1, p2, k3), "rational_polynomial" the same and
(k4, k5, k6), both as in OpenCV; "kannala_brandt" is OpenCV's fisheye, the equidistant one (k1, k2, k3, k4).
Source: foxglove.CameraCalibration, https://docs.foxglove.dev/docs/sdk/schemas/camera-calibration.
"""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class HumanLabels:
    """Labels of a human's body at one time, in the world."""

    joints_m: Float32Array
    """The 24 joints of SMPL, the pelvis first [m], shape (24, 3)."""
    box: Float64Array
    """Box around the body: centre x, y, z [m], length (where the human looks), width, height [m], yaw [rad],
    shape (7,)."""
    footprint_xy_m: Float32Array
    """The ground below the body: one point per occupied cell of 0.05 m [m], shape (P, 2)."""

    def __post_init__(self) -> None:
        check_array("joints_m", self.joints_m, np.float32, (24, 3))
        check_array("box", self.box, np.float64, (7,))
        check_array("footprint_xy_m", self.footprint_xy_m, np.float32, (None, 2))


@dataclass(frozen=True, kw_only=True, slots=True)
class Sample:
    """One sample, at a step of the robot's clock: what the robot saw, did and wanted, and the truth around it."""

    seq: int
    """Number of the sample in its episode, from 0."""
    crc32: int
    """Checksum of image and outputs, from `sample_crc32`."""
    time_ns: int
    """Simulated time since the episode began [ns]."""
    image: bytes
    """Encoded image (JPEG or PNG); empty where none was taken, see `EpisodeHeader.image_every`."""
    action_v_mps: float
    action_w_radps: float
    goal_xy_robot_m: tuple[float, float]
    """Goal in the robot's frame at this time (x forward, y left) [m]."""
    robot_xyzyaw: tuple[float, float, float, float]
    """Robot base on the floor: x, y, z [m], yaw [rad]."""
    humans_xyzyaw: tuple[tuple[float, float, float, float], ...]
    """Humans on the floor: x, y, z [m], yaw [rad]."""
    human_distance_m: float
    time_to_collision_s: float
    human_visible: bool
    expert_cost: float
    replanned: bool
    outputs: dict[str, bytes] = field(default_factory=dict, hash=False, metadata=OMITTED_WHEN_DEFAULT)
    """Further images of the same time by their names (`readygo.common.images.names`): of the first camera and of the
    others, encoded as `readygo.common.images.files` says, and rgb as `image` is."""
    labels: tuple[HumanLabels, ...] = field(default=(), hash=False, metadata=OMITTED_WHEN_DEFAULT)
    """Labels of the humans in the order of `humans_xyzyaw`; none unless `EpisodeHeader.labels` says so."""
    expert_commands: tuple[tuple[float, float], ...] = field(default=(), metadata=OMITTED_WHEN_DEFAULT)
    """The expert's labels, whether it drives or a policy: commands v [m/s], w [rad/s] over the next step and over every
    further one; empty where the expert was not asked."""
    risks: bytes = field(default=b"", metadata=OMITTED_WHEN_DEFAULT)
    """What would become of the robot under each command of `readygo.common.robot.command_grid`: 0 nothing, 1 a
    collision with an obstacle, 2 one with a human; empty where this was not computed."""

    @property
    def intact(self) -> bool:
        """True if the image bytes match their checksum."""
        return sample_crc32(self.image, self.outputs) == self.crc32

    @property
    def images_size_bytes(self) -> int:
        """Size of all images together."""
        return len(self.image) + sum(map(len, self.outputs.values()))


def sample_crc32(image: bytes, outputs: Mapping[str, bytes]) -> int:
    """CRC-32 of a sample's image, and after it of the names and images of its outputs in alphabetical order."""
    crc32 = zlib.crc32(image)
    for name in sorted(outputs):
        crc32 = zlib.crc32(outputs[name], zlib.crc32(name.encode(), crc32))
    return crc32


@dataclass(frozen=True, kw_only=True, slots=True)
class FurtherCamera:
    """What is constant over an episode of a camera besides the first one."""

    name: str
    height_px: int
    width_px: int
    K_px: tuple[float, ...]
    """Intrinsics [px], row-major, 9 numbers."""
    distortion_model: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """One of `DISTORTION_MODELS`."""
    distortion: tuple[float, ...] = field(default=(), metadata=OMITTED_WHEN_DEFAULT)
    """Coefficients of the distortion model."""

    def __post_init__(self) -> None:
        check_distortion(self.distortion_model, self.distortion)


def check_distortion(model: str, coefficients: Sequence[float]) -> None:
    """Raise ValueError unless a distortion model is known and has so many coefficients."""
    known = DISTORTION_MODELS.get(model)
    if known is None:
        raise ValueError(f"distortion_model must be one of {sorted(DISTORTION_MODELS)}, got {model!r}.")
    if len(coefficients) != known:
        raise ValueError(f"distortion model {model!r} has {known} coefficients, got {len(coefficients)}.")


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeHeader:
    """What is constant over an episode."""

    episode: EpisodeKey
    sample_count: int
    goal_xy_m: tuple[float, float]
    start_xyyaw: tuple[float, float, float]
    avatars: tuple[str, ...]
    encounters: tuple[str, ...]
    image_format: str
    """Encoding of the images: "jpeg" or "png"."""
    height_px: int
    width_px: int
    K_px: tuple[float, ...]
    """Intrinsics [px], row-major, 9 numbers."""
    distortion_model: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """One of `DISTORTION_MODELS`."""
    distortion: tuple[float, ...] = field(default=(), metadata=OMITTED_WHEN_DEFAULT)
    """Coefficients of the distortion model."""
    labels: bool = field(default=False, metadata=OMITTED_WHEN_DEFAULT)
    """True if every sample has the labels of its humans."""
    outcome: Outcome = field(default=Outcome.SUCCESS, metadata=OMITTED_WHEN_DEFAULT)
    """How the episode ended."""
    driver: DriverKind = field(default=DriverKind.EXPERT, metadata=OMITTED_WHEN_DEFAULT)
    """Driver of the robot: the expert or a policy."""
    policy: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """SHA-256 of the offered policy that drove, see `OfferReply.sha256`; empty if it was none: the expert
    drove, or the policy that the run began with."""
    image_every: int = field(default=1, metadata=OMITTED_WHEN_DEFAULT)
    """Samples from image to image: images, and what the expert would do, are there at samples 0, n, 2 n ... alone."""
    cameras: tuple[FurtherCamera, ...] = field(default=(), metadata=OMITTED_WHEN_DEFAULT)
    """The cameras besides the first one, in the order of their channels."""
    drawn: dict[str, float] = field(default_factory=dict, hash=False, metadata=OMITTED_WHEN_DEFAULT)
    """What the episode's robot drew from its ranges, by the names of `RobotRanges`."""

    def __post_init__(self) -> None:
        if self.image_every < 1:
            raise ValueError(f"image_every must be 1 or more, got {self.image_every}.")
        check_distortion(self.distortion_model, self.distortion)
        check_sha256("policy", self.policy, empty=True)


@dataclass(frozen=True, kw_only=True, slots=True)
class AppendRequest:
    """A batch of at most 8 consecutive samples; the last batch of an episode carries `last`."""

    attempt: int
    header: EpisodeHeader
    first_seq: int
    samples: tuple[Sample, ...]
    last: bool
    lease: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """Secret of the sender's lease, from `ClaimReply.lease`."""


class AppendStatus(enum.Enum):
    """What became of a batch."""

    OK = "ok"
    """The batch is buffered."""
    COMMITTED = "committed"
    """The episode is durable."""
    DUP = "dup"
    """The episode was durable already."""
    STALE = "stale"
    """The attempt lost its lease: drop the episode."""
    GAP = "gap"
    """Samples are missing: send again from `AppendReply.expected_seq`."""
    RETRY = "retry"
    """The coordinator did not answer: send the batch again."""


@dataclass(frozen=True, kw_only=True, slots=True)
class AppendReply:
    """What became of a batch, and why."""

    status: AppendStatus
    expected_seq: int = 0
    detail: str = ""
