"""Many robots at once: motion, limits, collisions and outcomes exactly as in `EpisodeSimulation`, in one kernel."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from readygo.common.arrays import AnyArray, BoolArray, Float32Array, Float64Array, Int8Array, Int64Array, UInt16Array
from readygo.common.episode.collision import disc_meets_cells, point_meets_humans
from readygo.common.kernels import kernel_with_cache
from readygo.common.messages.plan import Outcome
from readygo.common.robot.kinematics import limit_command, step_unicycle
from readygo.common.state_simulation.bank import EpisodeBank
from readygo.common.state_simulation.goal_distances import remaining_m
from readygo.common.state_simulation.observe import know, observe, told_count, truth_count
from readygo.common.state_simulation.randomness import next_index, next_uniform
from readygo.common.state_simulation.tracks import (
    TrackerNumbers,
    Tracks,
    begin_tracks,
    look,
    make_tracks,
)
from readygo.common.state_simulation.world import StateWorld

RUNNING, SUCCESS, STATIC_COLLISION, HUMAN_COLLISION, TIMEOUT = range(5)
"""Codes of outcomes."""
OUTCOMES = {
    SUCCESS: Outcome.SUCCESS,
    STATIC_COLLISION: Outcome.STATIC_COLLISION,
    HUMAN_COLLISION: Outcome.HUMAN_COLLISION,
    TIMEOUT: Outcome.TIMEOUT,
}
_limit_command: Any = kernel_with_cache(limit_command)
_step_unicycle = kernel_with_cache(step_unicycle)


@dataclass(frozen=True, kw_only=True)
class RewardConfig:
    """What a decision earns."""

    progress: float = 0.2
    """Per metre of the remaining distance."""
    second: float = -0.02
    """Per second."""
    success: float = 2.0
    """At the goal."""
    collision: float = -2.0
    """At a collision with an obstacle or a person."""
    impact: float = -1.0
    """Per m/s of the robot's speed at a collision with a person: a robot that stands was walked into."""
    near: float = -0.05
    """At contact with a person; falls to 0 at `near_m`."""
    near_m: float = 0.3
    """Distance of the borders of robot and person [m]."""
    wall: float = -0.03
    """At contact with an obstacle; falls to 0 at `wall_m`."""
    wall_m: float = 0.15
    """Distance of the border of the robot and an obstacle [m]."""
    turned: float = -0.01
    """Per rad/s of change of the yaw rate."""

    @property
    def numbers(self) -> "RewardNumbers":
        """The same for kernels."""
        return RewardNumbers(*(float(getattr(self, name)) for name in RewardNumbers._fields))


class RewardNumbers(NamedTuple):
    """A `RewardConfig` for kernels."""

    progress: float
    second: float
    success: float
    collision: float
    impact: float
    near: float
    near_m: float
    wall: float
    wall_m: float
    turned: float


class _Episodes(NamedTuple):
    """The arrays of an `EpisodeBank`."""

    start_xyyaw: Float64Array
    goal_xy_m: Float64Array
    human_count: Int64Array
    walks_m: Float32Array
    fields_cm: UInt16Array


class _Robots(NamedTuple):
    """N robots under way."""

    state: Float64Array
    """x, y [m], yaw [rad], v [m/s], w [rad/s], shape (N, 5)."""
    wanted: Float64Array
    """Command in force, shape (N, 2)."""
    step: Int64Array
    episode: Int64Array
    humans: Int64Array
    """People of the episode that take part: all or none."""
    remaining_m: Float64Array
    told: Float32Array
    truth: Float32Array


class Ended(NamedTuple):
    """What the last decision brought, by robot."""

    reward: Float32Array
    ended: BoolArray
    outcome: Int8Array
    """Code of the outcome, 0 while the episode runs."""
    length: Int64Array
    """Steps of the episode so far."""
    dynamic: BoolArray
    """True if people took part."""


@dataclass(frozen=True, kw_only=True)
class StateSimulationConfig:
    """How episodes are played."""

    hold_steps: int = 4
    """Steps that a command is held."""
    static_share: float = 0.3
    """Share of the episodes that are played without people."""
    repeats: float = 0.0
    """Chance that a robot that collided with a person begins the same episode again."""
    reward: RewardConfig = field(default_factory=RewardConfig)


class StateSimulation:
    """Robots that drive in the episodes of a bank, each in its own.

    Attributes:
        told: What the robots are told, see `observe`, shape (N, told_count).
        truth: What a critic is told, shape (N, truth_count).
        state: x, y [m], yaw [rad], v [m/s], w [rad/s], shape (N, 5).
        step: Steps of the present episodes, shape (N,).
        episode: Rows of the present episodes in the bank, shape (N,).
        remaining_m: Remaining distances to the goals [m], shape (N,).
        last: Results of the last decision.
    """

    def __init__(
        self,
        world: StateWorld,
        bank: EpisodeBank,
        numbers: TrackerNumbers,
        robot_count: int,
        *,
        config: StateSimulationConfig | None = None,
        seed: int = 0,
        knows_truth: bool = True,
    ) -> None:
        """Put all robots into the first episode.

        Args:
            world: Scene, robot and rules.
            bank: Episodes.
            numbers: Errors of perception.
            robot_count: Robots.
            config: How episodes are played.
            seed: Seed of all random streams.
            knows_truth: False leaves `truth` empty, which is faster.
        """
        self.world, self.bank, self.config = world, bank, config or StateSimulationConfig()
        self._numbers, self._knows = numbers, knows_truth
        self._episodes = _Episodes(*(getattr(bank, name) for name in _Episodes._fields))
        n, integers = robot_count, np.zeros((4, robot_count), np.int64)
        self._robots = _Robots(
            state=np.zeros((n, 5)),
            wanted=np.zeros((n, 2)),
            step=integers[0].copy(),
            episode=integers[1].copy(),
            humans=integers[2].copy(),
            remaining_m=np.zeros(n),
            told=np.zeros((n, told_count(world)), np.float32),
            truth=np.zeros((n, truth_count(world, bank.human_max) if knows_truth else 0), np.float32),
        )
        self.tracks: Tracks = make_tracks(n, bank.human_max)
        self.last = Ended(
            reward=np.zeros(n, np.float32),
            ended=np.zeros(n, np.bool_),
            outcome=np.zeros(n, np.int8),
            length=np.zeros(n, np.int64),
            dynamic=np.zeros(n, np.bool_),
        )
        self.told, self.truth = self._robots.told, self._robots.truth
        self.state, self.step = self._robots.state, self._robots.step
        self.episode, self.remaining_m = self._robots.episode, self._robots.remaining_m
        self._draws = np.random.default_rng(seed)
        self.begin(np.zeros(n, np.int64), np.ones(n, np.bool_))

    def __len__(self) -> int:
        return len(self.state)

    def begin(
        self,
        episodes: Sequence[int] | Int64Array,
        dynamic: Sequence[bool] | BoolArray,
        seeds: Sequence[int] | Int64Array | None = None,
        *,
        robots: Int64Array | None = None,
    ) -> None:
        """Put robots at the start of an episode.

        Args:
            episodes: Rows of the bank, shape (R,).
            dynamic: True where people take part, shape (R,).
            seeds: Seed of each robot's stream, shape (R,); drawn by default.
            robots: Which robots, shape (R,); all by default.
        """
        robots = np.arange(len(self)) if robots is None else robots
        if seeds is None:
            seeds = self._draws.integers(2**62, size=len(robots))
        self.last.ended[robots], self.last.outcome[robots] = False, RUNNING
        _begin_all(
            self.world, self._numbers, self._episodes, self._robots, self.tracks, self._knows, robots,
            np.asarray(episodes, np.int64), np.asarray(dynamic, np.bool_), np.asarray(seeds, np.int64),
        )  # fmt: skip

    def begin_anywhere(self, robots: Int64Array | None = None) -> None:
        """Put robots, all by default, into random episodes."""
        count = len(self) if robots is None else len(robots)
        episodes = self._draws.integers(len(self.bank), size=count)
        self.begin(episodes, self._draws.random(count) >= self.config.static_share, robots=robots)

    def seed(self, seed: int) -> None:
        """Begin the stream of `begin_anywhere` and of `begin` again."""
        self._draws = np.random.default_rng(seed)

    def advance(self, commands: Float64Array, *, again: bool = True) -> Ended:
        """Let every robot follow a command for `hold_steps`, or until its episode ends.

        Args:
            commands: v [m/s], w [rad/s], shape (N, 2).
            again: True begins another, random episode where one has ended; else its robot stays where it is, told
                the last state.

        Returns:
            `last`, which the next call overwrites.
        """
        _advance_all(
            self.world, self._numbers, self._episodes, self._robots, self.tracks, self._knows,
            np.ascontiguousarray(commands, np.float64), self.config.hold_steps, self.config.reward.numbers,
            again, float(self.config.static_share), float(self.config.repeats), self.last,
        )  # fmt: skip
        return self.last

    def snapshot(self) -> dict[str, AnyArray]:
        """All that changes, by name: `restore` continues from it."""
        return {name: array.copy() for name, array in self._arrays().items()}

    def restore(self, arrays: Mapping[str, AnyArray]) -> None:
        """Continue from a snapshot of as many robots in the same bank."""
        for name, array in self._arrays().items():
            array[...] = arrays[name]

    def _arrays(self) -> dict[str, AnyArray]:
        parts = (self._robots, self.tracks, self.last)
        return {f"{type(part).__name__}.{name}": array for part in parts for name, array in part._asdict().items()}


@kernel_with_cache
def _tell(
    world: StateWorld,
    numbers: TrackerNumbers,
    episodes: _Episodes,
    robots: _Robots,
    tracks: Tracks,
    knows: bool,
    n: int,
) -> None:
    e, row = robots.episode[n], robots.state[n]
    state = (row[0], row[1], row[2], row[3], row[4])
    goal = (episodes.goal_xy_m[e, 0], episodes.goal_xy_m[e, 1])
    observe(world, numbers, tracks, n, robots.step[n], state, goal, episodes.fields_cm[e], robots.told[n])
    if knows:
        remaining, told, truth = robots.remaining_m[n], robots.told[n], robots.truth[n]
        know(world, robots.step[n], state, remaining, episodes.walks_m[e], robots.humans[n], told, truth)


@kernel_with_cache
def _place_humans(episodes: _Episodes, e: int, step: int, count: int, out: Float64Array) -> None:
    row = min(step, episodes.walks_m.shape[1] - 1)
    for m in range(count):
        out[m, 0], out[m, 1] = episodes.walks_m[e, row, m, 0], episodes.walks_m[e, row, m, 1]


@kernel_with_cache
def _begin_one(
    world: StateWorld,
    numbers: TrackerNumbers,
    episodes: _Episodes,
    robots: _Robots,
    tracks: Tracks,
    n: int,
    e: int,
    dynamic: bool,
    seed: int,
    humans_m: Float64Array,
) -> None:
    robots.episode[n], robots.step[n] = e, 0
    robots.humans[n] = episodes.human_count[e] if dynamic else 0
    x, y, yaw = episodes.start_xyyaw[e, 0], episodes.start_xyyaw[e, 1], episodes.start_xyyaw[e, 2]
    state = robots.state[n]
    state[0], state[1], state[2], state[3], state[4] = x, y, yaw, 0.0, 0.0
    robots.remaining_m[n] = remaining_m(episodes.fields_cm[e], world.coarse, x, y)
    begin_tracks(tracks, n, seed)
    _place_humans(episodes, e, 0, robots.humans[n], humans_m)
    look(world, numbers, tracks, n, 0, (x, y, yaw), humans_m, robots.humans[n])


@kernel_with_cache
def _begin_all(
    world: StateWorld,
    numbers: TrackerNumbers,
    episodes: _Episodes,
    robots: _Robots,
    tracks: Tracks,
    knows: bool,
    which: Int64Array,
    rows: Int64Array,
    dynamic: BoolArray,
    seeds: Int64Array,
) -> None:
    humans_m = np.zeros((episodes.walks_m.shape[2], 2))
    for k in range(len(which)):
        n = which[k]
        _begin_one(world, numbers, episodes, robots, tracks, n, rows[k], dynamic[k], seeds[k], humans_m)
        _tell(world, numbers, episodes, robots, tracks, knows, n)


@kernel_with_cache
def _clearance_m(world: StateWorld, x: float, y: float) -> float:
    """Distance of the centre of a place's cell to the nearest obstacle [m]; 0 outside of the map."""
    origin_x, origin_y, cell = world.place
    i, j = math.floor((y - origin_y) / cell), math.floor((x - origin_x) / cell)
    inside = 0 <= i < world.clearance_m.shape[0] and 0 <= j < world.clearance_m.shape[1]
    return world.clearance_m[i, j] if inside else 0.0


@kernel_with_cache
def _judge(
    world: StateWorld, x: float, y: float, goal_x: float, goal_y: float, step: int, humans_m: Float64Array
) -> int:
    """Code of the outcome of a step, as `EpisodeSimulation` judges it."""
    origin_x, origin_y, cell = world.place
    radius = world.robot.radius_m
    # Most places are far from anything: that needs no exact answer.
    near = _clearance_m(world, x, y) <= radius + 0.71 * cell
    if near and disc_meets_cells(world.occupied, origin_x, origin_y, cell, x, y, radius):
        return STATIC_COLLISION
    if point_meets_humans(x, y, humans_m, world.contact_m):
        return HUMAN_COLLISION
    if math.hypot(goal_x - x, goal_y - y) <= world.success_radius_m:
        return SUCCESS
    return TIMEOUT if step >= world.step_limit else RUNNING


@kernel_with_cache
def _drive(
    world: StateWorld,
    numbers: TrackerNumbers,
    episodes: _Episodes,
    robots: _Robots,
    tracks: Tracks,
    n: int,
    command: tuple[float, float],
    hold_steps: int,
    humans_m: Float64Array,
) -> int:
    """Follow a command for some steps; returns the code of the outcome."""
    state, wanted, e, count = robots.state[n], robots.wanted[n], robots.episode[n], robots.humans[n]
    for _ in range(hold_steps):
        if robots.step[n] % world.control_every == 0:
            wanted[0], wanted[1] = command
        v, w = _limit_command(wanted[0], wanted[1], state[3], state[4], world.robot, world.dt_s)
        state[0], state[1], state[2] = _step_unicycle(state[0], state[1], state[2], v, w, world.dt_s)
        state[3], state[4] = v, w
        robots.step[n] += 1
        step = robots.step[n]
        _place_humans(episodes, e, step, count, humans_m)
        outcome = _judge(
            world, state[0], state[1], episodes.goal_xy_m[e, 0], episodes.goal_xy_m[e, 1], step, humans_m[:count]
        )
        if outcome != RUNNING:
            return outcome
        if step % numbers.every == 0:
            look(world, numbers, tracks, n, step, (state[0], state[1], state[2]), humans_m, count)
    return RUNNING


@kernel_with_cache
def _earn(
    world: StateWorld,
    reward: RewardNumbers,
    outcome: int,
    progress_m: float,
    time_s: float,
    turned: float,
    speed_mps: float,
    gap_m: float,
    wall_gap_m: float,
) -> float:
    """What a decision earns, see `RewardConfig`."""
    earned = reward.progress * progress_m + reward.second * time_s + reward.turned * turned
    if gap_m < reward.near_m:
        earned += reward.near * (1.0 - max(gap_m, 0.0) / reward.near_m)
    if wall_gap_m < reward.wall_m:
        earned += reward.wall * (1.0 - max(wall_gap_m, 0.0) / reward.wall_m)
    if outcome == SUCCESS:
        earned += reward.success
    elif outcome in (STATIC_COLLISION, HUMAN_COLLISION):
        earned += reward.collision
    if outcome == HUMAN_COLLISION:
        earned += reward.impact * abs(speed_mps)
    return earned


@kernel_with_cache
def _advance_all(
    world: StateWorld,
    numbers: TrackerNumbers,
    episodes: _Episodes,
    robots: _Robots,
    tracks: Tracks,
    knows: bool,
    commands: Float64Array,
    hold_steps: int,
    reward: RewardNumbers,
    again: bool,
    static_share: float,
    repeats: float,
    last: Ended,
) -> None:
    humans_m = np.zeros((episodes.walks_m.shape[2], 2))
    for n in range(len(commands)):
        if not again and last.outcome[n] != RUNNING:
            last.reward[n], last.ended[n] = 0.0, False
            continue
        e, state, turn_before, step_before = robots.episode[n], robots.state[n], robots.state[n, 4], robots.step[n]
        command = (commands[n, 0], commands[n, 1])
        outcome = _drive(world, numbers, episodes, robots, tracks, n, command, hold_steps, humans_m)
        gap = np.inf
        for m in range(robots.humans[n]):
            dx, dy = humans_m[m, 0] - state[0], humans_m[m, 1] - state[1]
            gap = min(gap, math.sqrt(dx * dx + dy * dy) - world.contact_m)
        remaining = remaining_m(episodes.fields_cm[e], world.coarse, state[0], state[1])
        progress, robots.remaining_m[n] = robots.remaining_m[n] - remaining, remaining
        time_s, turned = (robots.step[n] - step_before) * world.dt_s, abs(state[4] - turn_before)
        wall_gap = _clearance_m(world, state[0], state[1]) - world.robot.radius_m
        last.reward[n] = _earn(world, reward, outcome, progress, time_s, turned, state[3], gap, wall_gap)
        last.ended[n], last.outcome[n] = outcome != RUNNING, outcome
        last.length[n], last.dynamic[n] = robots.step[n], robots.humans[n] > 0
        if outcome != RUNNING and again:
            stream = tracks.random[n]
            row, dynamic = next_index(stream, len(episodes.start_xyyaw)), next_uniform(stream) >= static_share
            if outcome == HUMAN_COLLISION and next_uniform(stream) < repeats:
                row, dynamic = e, True
            seed = next_index(stream, 1 << 53)
            _begin_one(world, numbers, episodes, robots, tracks, n, row, dynamic, seed, humans_m)
        _tell(world, numbers, episodes, robots, tracks, knows, n)
