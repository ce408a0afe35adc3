"""The animator: how humans move along their trajectories."""

from services.animator.config import AnimatorConfig
from services.animator.gait import walk
from services.animator.gait_person import GaitSkeleton, skeleton_of
from services.animator.handlers import Animator, handle_animate
from services.animator.quality import MotionQuality, measure
from services.animator.service import attach

__all__ = [
    "Animator",
    "AnimatorConfig",
    "GaitSkeleton",
    "MotionQuality",
    "attach",
    "handle_animate",
    "measure",
    "skeleton_of",
    "walk",
]
