"""Which samples a batch holds, which frames they see, and the numbers that go with them."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, Int64Array, UInt8Array
from readygo.common.errors import DatasetError
from readygo.common.messages.plan import DriverKind
from readygo.common.policy.motion import odometry, own_motion
from readygo.common.policy.traits import LIMITS_AT, traits_of
from readygo.common.policy.windows import FRAME_COUNT, window_rows
from readygo.common.robot import Clock, RobotConfig
from readygo.common.robot.command_grid import COMMAND_COUNT, UNKNOWN_RISK
from readygo.services.trainer.episodes import TrainingEpisode

USABLE_MIN = 0.05
"""Least share of usable samples: with fewer, pictures and windows do not meet but at the beginning of episodes."""
SAME_COMMAND = 1e-4
"""Commands [m/s, rad/s] that differ by less are the same."""


@dataclass(frozen=True, kw_only=True)
class WindowTiming:
    """Which steps belong together."""

    spacing_steps: int
    """Steps between the frames of a window."""
    frame_count: int = FRAME_COUNT
    """Frames of a window."""
    latency_steps: int = 0
    """Steps between the latest frame of a window and its sample."""
    ahead_steps: int = 0
    """Steps from a sample to the command that it teaches."""
    clock: Clock = field(default_factory=Clock)
    """The robot's clock."""
    command_count: int = COMMAND_COUNT
    """Commands of the robot's grid, which data tell the risks of."""
    to_image: bool = False
    """True if the ego-motion is that up to the latest frame, not up to the sample."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingSamples:
    """The numbers of some episodes, in flat arrays over all of their S samples."""

    names: tuple[str, ...]
    """Names of the episodes."""
    robots: tuple[RobotConfig, ...]
    """The robots of the episodes."""
    episode: Int64Array
    """Row in `names` of each sample's episode, shape (S,)."""
    first: Int64Array
    """First sample of each sample's episode, shape (S,)."""
    last: Int64Array
    """Last sample of each sample's episode, shape (S,)."""
    driven_last: Int64Array
    """Last sample up to which the expert has driven undisturbed from this one on; the sample itself where it has not,
    shape (S,)."""
    pictured_at: Int64Array
    """The sample at which the latest image was taken, shape (S,)."""
    by_policy: BoolArray
    """True where a policy drove, shape (S,)."""
    usable: BoolArray
    """True where all frames of the window were taken, the robot is commanded and there is a target, shape (S,)."""
    targets: Float32Array
    """Commands that the samples teach: v [m/s], w [rad/s], shape (S, 2)."""
    motion: Float32Array
    """Own motion, see `readygo.common.policy.motion.own_motion`, shape (S, 3 K + 2)."""
    goals_xy_m: Float32Array
    """Goals in the robot's frame [m], shape (S, 2)."""
    xyyaw: Float64Array
    """Robot's pose: x, y [m], yaw [rad], shape (S, 3)."""
    risks: UInt8Array
    """Risk of each command, see `TrainingEpisode.risks`; `UNKNOWN_RISK` where the data do not say, shape (S, C)."""
    humans: Float32Array
    """The nearest visible human, see `TrainingEpisode.humans`; NaN where the data do not say, shape (S, 3)."""

    def __len__(self) -> int:
        return len(self.first)

    @cached_property
    def traits(self) -> Float64Array:
        """What a policy for several robots is told of each episode's, shape (E, TRAIT_COUNT)."""
        return np.array([traits_of(robot) for robot in self.robots])

    def limits(self, samples: Int64Array) -> Float32Array:
        """Largest v [m/s] and w [rad/s] of the robots of some samples, shape (B, 2)."""
        return self.traits[self.episode[samples], LIMITS_AT:].astype(np.float32)

    @cached_property
    def usable_samples(self) -> Int64Array:
        """Numbers of the samples that can be learned from, ascending.

        Raises:
            DatasetError: If they are too few.
        """
        found = np.flatnonzero(self.usable)
        if len(found) < len(self) * USABLE_MIN:
            raise DatasetError(
                f"Only {len(found)} of {len(self)} samples have images at all times of their windows; record with a "
                "[driver] camera_hz that divides the spacing of the frames."
            )
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """Samples and the distinct frames that their windows see."""

    samples: Int64Array
    """Sample indices, shape (B,)."""
    frames: Int64Array
    """Sample indices of the distinct frames, ascending, shape (F,)."""
    window: Int64Array
    """Rows of `frames` that each sample sees, oldest first, shape (B, `frame_count`)."""


def episode_table(episode: TrainingEpisode, robot: RobotConfig, timing: WindowTiming) -> TrainingSamples:
    """The table of one episode.

    Args:
        episode: The episode.
        robot: That of the run; the episode has one of its ranges, if it has any.
        timing: Which steps belong together.
    """
    count = episode.sample_count
    steps, zeros = np.arange(count), np.zeros(count, np.int64)
    clock = timing.clock
    poses = odometry(episode.actions, clock.dt_s)
    rows = _window_rows(steps, zeros, timing)
    # A command is held: what it leads to is what is executed at the end of that.
    targets = _targets(episode, timing.ahead_steps + clock.control_every - 1)
    seen = episode.pictured[rows].all(axis=1) & np.isfinite(targets).all(axis=1)
    previous = np.concatenate([np.zeros((1, 2), np.float32), episode.actions[:-1]])
    return TrainingSamples(
        names=(episode.name,),
        robots=(robot.with_values(episode.drawn),),
        episode=zeros,
        first=zeros,
        last=np.full(count, count - 1),
        driven_last=_driven_last(episode),
        pictured_at=np.maximum.accumulate(np.where(episode.pictured, steps, 0)),
        by_policy=np.full(count, episode.driver is DriverKind.POLICY),
        usable=seen & (steps % clock.control_every == 0),
        targets=targets,
        motion=own_motion(poses[rows[:, :-1]], poses[rows[:, -1]] if timing.to_image else poses, previous),
        goals_xy_m=episode.goals_xy_m,
        xyyaw=episode.xyyaw,
        risks=_risks(episode, timing.command_count),
        humans=np.full((count, 3), np.nan, np.float32) if episode.humans is None else episode.humans,
    )


def join_tables(tables: Sequence[TrainingSamples]) -> TrainingSamples:
    """One table of several.

    Raises:
        DatasetError: If there is none.
    """
    if not tables:
        raise DatasetError("There is no episode to train on.")
    counts = np.array([len(table) for table in tables])
    begins = np.repeat(np.cumsum(counts) - counts, counts)
    columns = {
        item.name: np.concatenate([getattr(table, item.name) for table in tables])
        for item in fields(TrainingSamples)
        if item.name not in ("names", "robots")
    }
    for name in ("first", "last", "driven_last", "pictured_at"):
        columns[name] = columns[name] + begins
    columns["episode"] = np.repeat(np.arange(len(tables)), counts)
    return TrainingSamples(
        names=tuple(name for table in tables for name in table.names),
        robots=tuple(robot for table in tables for robot in table.robots),
        **columns,
    )


def _window_rows(samples: Int64Array, first: Int64Array, timing: WindowTiming) -> Int64Array:
    newest, every = samples - timing.latency_steps, timing.clock.image_every
    return window_rows(newest, first, timing.spacing_steps, timing.frame_count, every)


def _risks(episode: TrainingEpisode, command_count: int) -> UInt8Array:
    if episode.risks is None:
        return np.full((episode.sample_count, command_count), UNKNOWN_RISK, np.uint8)
    if episode.risks.shape[1] != command_count:
        raise DatasetError(
            f"Episode {episode.name} tells the risks of {episode.risks.shape[1]} commands, the robot's grid has "
            f"{command_count}; record it again with this robot."
        )
    return episode.risks


def _targets(episode: TrainingEpisode, ahead_steps: int) -> Float32Array:
    """The expert's commands some steps ahead; where the expert was not asked, what was executed then."""
    if episode.expert is not None:
        return episode.expert[:, min(ahead_steps, episode.expert.shape[1] - 1)]
    return episode.actions[np.minimum(np.arange(episode.sample_count) + ahead_steps, episode.sample_count - 1)]


def _driven_last(episode: TrainingEpisode) -> Int64Array:
    steps = np.arange(episode.sample_count)
    if episode.driver is not DriverKind.EXPERT:
        return steps
    if episode.expert is None:
        return np.full(len(steps), len(steps) - 1)
    other = np.any(np.abs(episode.expert[:, 0] - episode.actions) > SAME_COMMAND, axis=1)
    ends = np.append(np.flatnonzero(other), len(steps) - 1)
    return np.asarray(ends[np.searchsorted(ends, steps)], np.int64)


def held_out_names(names: Sequence[str], fraction: float) -> set[str]:
    """Episodes to hold out, chosen by the hash of their names: the order does not matter.

    Raises:
        DatasetError: If there are fewer than two episodes.
    """
    if len(names) < 2:
        raise DatasetError(f"Training needs 2 or more episodes, got {len(names)}; generate more, or give --val.")
    count = min(max(1, round(fraction * len(names))), len(names) - 1)
    return set(sorted(names, key=name_rank)[:count])


def name_rank(name: str) -> float:
    """A number in [0, 1) for a name, evenly spread."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big") / 2**64


def make_batch(samples: Int64Array, first: Int64Array, timing: WindowTiming) -> Batch:
    """The batch of some samples; before an episode's start its first frame is seen.

    Args:
        samples: Sample indices, shape (B,).
        first: First sample of each sample's episode for the whole table, shape (S,).
        timing: Which steps belong together.
    """
    seen = _window_rows(samples, first[samples], timing)
    frames, window = np.unique(seen, return_inverse=True)
    return Batch(samples=samples, frames=frames, window=window.reshape(seen.shape))


def draw_samples(
    table: TrainingSamples, *, batch_size: int, chain_length: int, spacing_steps: int, rng: np.random.Generator
) -> Int64Array:
    """Random samples for one batch, all usable ones alike likely but for those near the ends of episodes.

    Samples that are one frame spacing apart form chains of at most `chain_length`: a chain of n samples sees only
    n + `frame_count` - 1 distinct frames.

    Returns:
        Sample indices, shape (batch_size,).
    """
    usable = table.usable_samples
    chains: list[Int64Array] = []
    total = 0
    while total < batch_size:
        sample = int(usable[rng.integers(len(usable))])
        first, last = int(table.first[sample]), int(table.last[sample])
        back = min(int(rng.integers(chain_length)), (sample - first) // spacing_steps)
        begin = sample - back * spacing_steps
        end = min(begin + chain_length * spacing_steps, last + 1)
        chain = np.arange(begin, end, spacing_steps)
        chain = chain[table.usable[chain]][: batch_size - total]
        chains.append(chain)
        total += len(chain)
    return np.concatenate(chains)


def spread_chains(table: TrainingSamples, limit: int, *, chain_length: int, spacing_steps: int) -> Int64Array:
    """At most `limit` usable samples in chains of `draw_samples`, the chains evenly spread, in order."""
    starts = spread_samples(table, max(1, limit // chain_length))
    steps = np.arange(chain_length) * spacing_steps
    samples = starts[:, None] + steps
    chains: Int64Array = samples[samples <= table.last[starts][:, None]]
    kept: Int64Array = chains[table.usable[chains]]
    return kept


def chain_rows(samples: Int64Array, first: Int64Array, spacing_steps: int) -> Int64Array:
    """The chains of a batch: rows of its samples, each chain in order and then -1, shape (N, T).

    Args:
        samples: Samples of the batch, shape (B,).
        first: First sample of each one's episode, shape (B,).
        spacing_steps: Steps between the samples of a chain.
    """
    begins = np.ones(len(samples), np.bool_)
    begins[1:] = (np.diff(samples) != spacing_steps) | (np.diff(first) != 0)
    chain = np.cumsum(begins) - 1
    place = np.arange(len(samples)) - np.flatnonzero(begins)[chain]
    rows = np.full((chain[-1] + 1, place.max() + 1), -1, np.int64)
    rows[chain, place] = np.arange(len(samples))
    return rows


def spread_samples(table: TrainingSamples, limit: int) -> Int64Array:
    """At most `limit` usable samples, evenly spread, in order."""
    usable = table.usable_samples
    return usable[:: max(1, -(-len(usable) // limit))]
