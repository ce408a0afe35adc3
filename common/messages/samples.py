"""Recorded samples on their way from a renderer to a recorder."""

import zlib
from dataclasses import dataclass

from common.messages.episode import EpisodeKey


@dataclass(frozen=True, kw_only=True, slots=True)
class Sample:
    """One 20 Hz sample: what the robot saw, did and wanted, and the truth around it."""

    seq: int
    """Number of the sample in its episode, from 0."""
    crc32: int
    """CRC-32 of `image`."""
    time_ns: int
    """Simulated time since the episode began [ns]."""
    image: bytes
    """Encoded image (JPEG or PNG)."""
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

    @property
    def intact(self) -> bool:
        """True if the image bytes match their checksum."""
        return zlib.crc32(self.image) == self.crc32


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
    """"jpeg" or "png"."""
    height_px: int
    width_px: int
    K_px: tuple[float, ...]
    """Intrinsics [px], row-major, 9 numbers."""


@dataclass(frozen=True, kw_only=True, slots=True)
class AppendRequest:
    """A batch of at most 8 consecutive samples; the last batch of an episode carries `last`."""

    attempt: int
    header: EpisodeHeader
    first_seq: int
    samples: tuple[Sample, ...]
    last: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class AppendReply:
    """What became of a batch.

    `status` is "ok" (buffered), "committed" (the episode is durable), "dup" (it was already), "stale" (the attempt
    lost its lease: drop the episode), "gap" (send again from `expected_seq`), or "retry" (the coordinator did not
    answer: send the last batch again).
    """

    status: str
    expected_seq: int = 0
    detail: str = ""
