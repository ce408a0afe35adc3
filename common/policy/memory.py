"""What a policy remembers of an episode: one definition for simulated robots, which step, and for real ones."""

from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np

from readygo.common.arrays import AnyArray, Float32Array, UInt8Array
from readygo.common.policy.motion import own_motion
from readygo.common.policy.windows import FRAME_COUNT, window_at
from readygo.common.robot import Clock, step_unicycle
from readygo.common.robot.standing import WAIT_S, Standing

Pose = tuple[float, float, float]


@dataclass(eq=False, slots=True)
class SeenFrame:
    """What came of the images of one time."""

    image: UInt8Array | None
    """The images themselves, as the policy sees them, shape (H, W, C); None once they are encoded."""
    cached: dict[str, AnyArray] = field(default_factory=dict)
    """What the policy's graph answered for them, by the names of its cache's inputs; empty before."""


@dataclass
class Kept:
    """What a policy keeps between its decisions."""

    state: dict[str, AnyArray] = field(default_factory=dict)
    """State of its graph, by the names of the graph's inputs; empty at the start."""
    decision: Float32Array | None = None
    """The latest command: v [m/s], w [rad/s], shape (2,)."""
    due_ns: int = 0
    """Simulated time of its next decision [ns]."""
    goal: SeenFrame | None = None
    """What the robot would see at the goal; None where it is not known."""
    standing: Standing = field(default_factory=Standing)
    """How long the robot has stood."""


class PolicyMemory:
    """Frames of the last spacings, and where the robot was, each with its time.

    A simulation calls `advance` once a step, and `see` when a frame comes. A robot says by `move` where its odometry
    has it, and by `see` when a frame was taken, as they come. The times are of one clock, and rise.

    Args:
        spacing_ns: Time between the frames that it sees [ns].
        latency_ns: Time from when a frame is taken until a simulated robot has it [ns].
        frame_count: Frames that it sees together.
        clock: Steps of a simulated robot; those of one that names no rates by default.
    """

    def __init__(
        self, spacing_ns: int, latency_ns: int = 0, frame_count: int = FRAME_COUNT, clock: Clock | None = None
    ) -> None:
        self._spacing_ns, self._latency_ns, self._count = spacing_ns, latency_ns, frame_count
        self._clock, self._steps = clock or Clock(), 0
        self._seen_ns: list[int] = []
        self._seen: list[SeenFrame] = []
        self._poses_ns: list[int] = []
        self._poses: list[Pose] = []
        self.traits = np.zeros(0, np.float32)
        """What a policy for several robots is told of the one that it drives, shape (TRAIT_COUNT,)."""
        self.kept = Kept()
        """What the policy carries from a decision to the next."""

    def see(self, image: UInt8Array, time_ns: int | None = None) -> None:
        """Remember a frame.

        Args:
            image: What the policy sees, shape (H, W, C).
            time_ns: When it was taken [ns]; by default the latency before the robot's last pose.
        """
        self._seen_ns.append(self._poses_ns[-1] - self._latency_ns if time_ns is None else time_ns)
        self._seen.append(SeenFrame(image))
        # One that is older than all that can be asked for stays: it is the nearest one after a pause.
        stale = max(bisect_right(self._seen_ns, self._seen_ns[-1] - self._span_ns) - 1, 0)
        del self._seen_ns[:stale], self._seen[:stale]

    def show_goal(self, image: UInt8Array) -> None:
        """Remember what the robot would see at the goal.

        Args:
            image: sRGB, shape (H, W, 3).
        """
        self.kept.goal = SeenFrame(image)

    @property
    def seen_ns(self) -> int:
        """When the newest frame was taken [ns]."""
        return self._seen_ns[-1]

    @property
    def newest_pose(self) -> tuple[int, Pose]:
        """Where the robot was last, and when [ns]."""
        return self._poses_ns[-1], self._poses[-1]

    def window(self) -> list[SeenFrame]:
        """What the policy sees together, oldest first: the newest, and what is nearest to each spacing before it.

        An episode's first one stands for those before.
        """
        return [self._seen[row] for row in window_at(self._seen_ns, self._spacing_ns, self._count)]

    def move(self, time_ns: int, pose: Pose) -> None:
        """Remember where the robot was.

        Args:
            time_ns: When [ns].
            pose: x, y [m], yaw [rad, not wrapped] in any frame that stands still.
        """
        self._poses_ns.append(time_ns)
        self._poses.append(pose)
        # The oldest frame that may be asked for was taken a span and a latency ago, and a pause longer.
        oldest_ns = min(self._seen_ns[0] if self._seen_ns else time_ns, time_ns - self._latency_ns)
        stale = max(bisect_right(self._poses_ns, oldest_ns) - 1, 0)
        del self._poses_ns[:stale], self._poses[:stale]

    def advance(self, command: Float32Array) -> None:
        """Remember that a simulated robot made a step; the first call is the episode's begin.

        Args:
            command: v [m/s], w [rad/s] executed over it, shape (2,); of no meaning at the first call.
        """
        if not self._poses:
            self.move(0, (0.0, 0.0, 0.0))
            return
        v_mps, w_radps = command.tolist()
        self._steps += 1
        pose = step_unicycle(*self._poses[-1], v_mps, w_radps, self._clock.dt_s)
        self.move(self._clock.time_ns(self._steps), pose)

    def must_move(self) -> bool:
        """True if the robot has stood too long; ask at each decision."""
        time_ns, (x_m, y_m, _) = self.newest_pose
        return bool(self.kept.standing.seconds(np.array([time_ns / 1e9]), np.array([[x_m, y_m]]))[0] >= WAIT_S)

    def own_motion(self, command: Float32Array, present_ns: int | None = None) -> Float32Array:
        """Ego-motion of the window, see `readygo.common.policy.motion.own_motion`, shape (3 (frame_count - 1) + 2,).

        Args:
            command: v [m/s], w [rad/s] executed last, shape (2,).
            present_ns: Time of the present pose [ns]; by default that of the newest one.
        """
        rows = window_at(self._seen_ns, self._spacing_ns, self._count)[:-1]
        older = np.array([[self.pose_at(self._seen_ns[row]) for row in rows]]).reshape(1, -1, 3)
        present = self._poses[-1] if present_ns is None else self.pose_at(present_ns)
        features: Float32Array = own_motion(older, np.array([present]), command[None])[0]
        return features

    @property
    def _span_ns(self) -> int:
        return (self._count - 1) * self._spacing_ns

    def pose_at(self, time_ns: int) -> Pose:
        """Where the robot was at a time, between the poses that are known.

        Args:
            time_ns: When [ns].

        Returns:
            x, y [m], yaw [rad].
        """
        after = bisect_right(self._poses_ns, time_ns)
        if after == 0 or after == len(self._poses) or self._poses_ns[after - 1] == time_ns:
            return self._poses[max(after - 1, 0)]
        before_ns, after_ns = self._poses_ns[after - 1], self._poses_ns[after]
        share = (time_ns - before_ns) / (after_ns - before_ns)
        x, y, yaw = (a + share * (b - a) for a, b in zip(self._poses[after - 1], self._poses[after], strict=True))
        return x, y, yaw
