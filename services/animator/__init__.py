"""The animator: how humans move along their trajectories."""

from typing import TYPE_CHECKING

from readygo.common.lazy import lazy_names

if TYPE_CHECKING:
    from readygo.services.animator.config import AnimatorConfig as AnimatorConfig
    from readygo.services.animator.gait.human import skeleton_of as skeleton_of
    from readygo.services.animator.gait.quality import measure as measure
    from readygo.services.animator.gait.walk import walk as walk
    from readygo.services.animator.handlers import Animator as Animator
    from readygo.services.animator.handlers import handle_animate as handle_animate
    from readygo.services.animator.priormdm.checkpoint import files_digest as files_digest
    from readygo.services.animator.priormdm.source import device_numeric_class as device_numeric_class
    from readygo.services.animator.retime import RetimedWalk as RetimedWalk
    from readygo.services.animator.service import attach as attach
else:
    _NAMES = {
        ".config": ("AnimatorConfig",),
        ".gait.human": ("skeleton_of",),
        ".gait.quality": ("measure",),
        ".gait.walk": ("walk",),
        ".handlers": (
            "Animator",
            "handle_animate",
        ),
        ".priormdm.checkpoint": ("files_digest",),
        ".priormdm.source": ("device_numeric_class",),
        ".retime": ("RetimedWalk",),
        ".service": ("attach",),
    }
    __all__ = [name for names in _NAMES.values() for name in names]
    __getattr__ = lazy_names(__name__, _NAMES)
