"""Episodes for display: poses of robot and humans over time, and camera images."""

import bisect
import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.dataset.schemas import NS_PER_S
from readygo.common.fleet.shown import is_shown, state_of
from readygo.common.frames import wrap_angle
from readygo.common.images.names import RGB
from readygo.common.messages import CommittedEpisode, EpisodeKey, Outcome, Sample
from readygo.common.messages.live import LivePlan, LivePreview, LiveState

Pictures = Mapping[str, bytes]
"""Encoded images of one time by name (`readygo.common.images.names`)."""
Pose = tuple[float, float, float, float]
"""Pose on the floor: x, y, z [m], yaw [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeTrack:
    """Known states and images of an episode, in order of time."""

    episode: EpisodeKey
    states: Sequence[LiveState]
    """States of the episode, at least one."""
    images: Sequence[tuple[int, Pictures]] = ()
    """Simulated times [ns], with the images of that time."""
    image_format: str = "jpeg"
    outcome: Outcome | None = None
    """Outcome of the episode; None while it runs."""
    policy: str = ""
    """SHA-256 over the files of the policy that drove; empty for the expert."""
    replans: Float64Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Positions of the expert's replans [m], shape (R, 3)."""

    @property
    def duration_s(self) -> float:
        """Time of the last state [s]."""
        return self.states[-1].time_ns / NS_PER_S

    def at(self, time_s: float) -> LiveState:
        """The state at a time, interpolated between known states."""
        times_ns = [state.time_ns for state in self.states]
        after = bisect.bisect_left(times_ns, time_s * NS_PER_S)
        if after == 0:
            return self.states[0]
        if after == len(self.states):
            return self.states[-1]
        before_ns, after_ns = times_ns[after - 1], times_ns[after]
        share = (time_s * NS_PER_S - before_ns) / max(after_ns - before_ns, 1)
        return between(self.states[after - 1], self.states[after], share)

    def images_at(self, time_s: float) -> Pictures:
        """The newest images at a time; empty before the first."""
        row = bisect.bisect_right([time_ns for time_ns, _ in self.images], time_s * NS_PER_S + 1)
        return self.images[max(0, row - 1)][1] if self.images else {}

    @property
    def way(self) -> Float64Array:
        """The robot's path [m], shape (N, 3)."""
        return np.array([state.robot_xyzyaw[:3] for state in self.states])


def between(before: LiveState, after: LiveState, share: float) -> LiveState:
    """Interpolate two states at a share of the time between them, 0..1."""
    if share <= 0.0 or len(before.humans_xyzyaw) != len(after.humans_xyzyaw):
        return before
    if share >= 1.0:
        return after
    pairs = zip(before.humans_xyzyaw, after.humans_xyzyaw, strict=True)
    return dataclasses.replace(
        before,
        time_ns=round(before.time_ns + share * (after.time_ns - before.time_ns)),
        robot_xyzyaw=_between(before.robot_xyzyaw, after.robot_xyzyaw, share),
        humans_xyzyaw=tuple(_between(a, b, share) for a, b in pairs),
    )


def _between(a: Pose, b: Pose, share: float) -> Pose:
    x, y, z = (start + share * (end - start) for start, end in zip(a[:3], b[:3], strict=True))
    return x, y, z, a[3] + share * float(wrap_angle(b[3] - a[3]))


def track_of(committed: CommittedEpisode) -> EpisodeTrack:
    """The track of a recorded episode."""
    header = committed.header
    states = [state_of(header, sample) for sample in committed.samples]
    replans = [state.robot_xyzyaw[:3] for state in states if state.replanned]
    return EpisodeTrack(
        episode=header.episode,
        states=states,
        images=[(sample.time_ns, pictures_of(sample)) for sample in committed.samples if sample.image],
        image_format=header.image_format,
        outcome=header.outcome,
        policy=header.policy,
        replans=np.array(replans).reshape(-1, 3),
    )


def pictures_of(seen: Sample | LivePreview) -> Pictures:
    """The encoded images of a sample or a preview, by name."""
    return {RGB: seen.image} | {name: image for name, image in seen.outputs.items() if is_shown(name)}


def on_floor(xy_m: Float32Array, height_m: float) -> Float64Array:
    """Points of the ground [m] at a height, shape (N, 2) -> (N, 3)."""
    return np.column_stack([xy_m, np.full(len(xy_m), height_m)]).astype(np.float64)


def replans_of(plan: LivePlan, height_m: float) -> Float64Array:
    """Positions of a plan's replans on a floor of this height [m], shape (R, 3)."""
    return on_floor(plan.robot_xyyaw[plan.replanned, :2], height_m)


def time_text(time_s: float) -> str:
    """A time of an episode as readable text."""
    return f"{time_s:.1f} s" if math.isfinite(time_s) else "never"
