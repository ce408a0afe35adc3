"""The animator: how humans move along their trajectories."""

from services.animator.config import AnimatorConfig
from services.animator.handlers import Animator, handle_animate
from services.animator.service import attach

__all__ = ["Animator", "AnimatorConfig", "attach", "handle_animate"]
