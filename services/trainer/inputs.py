"""What a policy network is given: its frames, the robot's ego-motion, the goal and which robot it drives."""

import enum
from dataclasses import dataclass

from readygo.common.images.names import RGB
from readygo.common.policy.sight import channels_of
from readygo.common.policy.windows import FRAME_COUNT

GOAL_SCALE_M = 10.0
"""Goals are divided by this and clipped to [-1, 1] [m]."""


class Fusion(enum.Enum):
    """Where the frames of a policy meet."""

    LATE = "late"
    """The encoder sees one frame; the latents of all are put side by side."""
    EARLY = "early"
    """The encoder sees all frames stacked: one latent."""


class GoalForm(enum.Enum):
    """What a policy is told of its goal."""

    POINT = "point"
    """Position of the goal in the robot's frame: dx, dy [m]."""
    IMAGE = "image"
    """Image that the robot would see at the goal."""
    BOTH = "both"


class MotionInput(enum.Enum):
    """Ego-motion that a policy is given."""

    POSES = "poses"
    """Poses of the older frames in the present robot frame (dx, dy [m], dyaw [rad] each), the oldest first, then
    v [m/s] and w [rad/s] executed over the last step."""
    COMMAND = "command"
    """v [m/s], w [rad/s] executed over the last step, then 1 where they are known; 0, 0, 0 where they are not."""

    def width(self, frame_count: int) -> int:
        """Number of features of a policy that sees some frames together."""
        return 3 * (frame_count - 1) + 2 if self is MotionInput.POSES else 3


@dataclass(frozen=True, kw_only=True)
class PolicyInputs:
    """What encoder and head of a policy network take."""

    fusion: Fusion = Fusion.LATE
    latent_count: int = 20
    """Numbers that the encoder answers."""
    motion: MotionInput = MotionInput.POSES
    frame_count: int = FRAME_COUNT
    """Frames that it sees together, one frame spacing apart."""
    images: tuple[str, ...] = (RGB,)
    """What each frame is of, in this order: see `readygo.common.policy.sight`."""
    goal: GoalForm = GoalForm.POINT
    """Form in which the policy gets its goal."""
    robot: bool = False
    """True if the head is told which robot it drives."""
    memory_count: int = 0
    """Numbers that it remembers from frame to frame, one frame spacing apart."""

    @property
    def frames_together(self) -> int:
        """Frames that the encoder sees at once."""
        return self.frame_count if self.fusion is Fusion.EARLY else 1

    @property
    def image_channels(self) -> int:
        """Channels of all images that the encoder sees at once."""
        return channels_of(self.images) * self.frames_together

    @property
    def latents_width(self) -> int:
        """Latents that the head takes: of the frames, and after them of the goal's image."""
        frames = 1 if self.fusion is Fusion.EARLY else self.frame_count
        return self.latent_count * (frames + (self.goal is not GoalForm.POINT))

    @property
    def feature_count(self) -> int:
        """Numbers that the head takes: latents, ego-motion, memory, goal."""
        return self.memory_input_count + self.memory_count + (0 if self.goal is GoalForm.IMAGE else 2)

    @property
    def memory_input_count(self) -> int:
        """Numbers that the memory takes: latents and ego-motion."""
        return self.latents_width + self.motion.width(self.frame_count)
