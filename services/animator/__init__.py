"""The animator: how humans move along their trajectories."""

from readygo.services.animator.config import AnimatorConfig
from readygo.services.animator.gait.human import GaitSkeleton, skeleton_of
from readygo.services.animator.gait.quality import MotionQuality, measure
from readygo.services.animator.gait.walk import walk
from readygo.services.animator.handlers import Animator, handle_animate
from readygo.services.animator.service import attach

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
