"""The recorder: acknowledged samples in, durable MCAP shards out."""

from typing import TYPE_CHECKING

from readygo.common.lazy import lazy_names

if TYPE_CHECKING:
    from readygo.services.recorder.config import RecorderConfig as RecorderConfig
    from readygo.services.recorder.handlers import Recorder as Recorder
    from readygo.services.recorder.handlers import handle_append as handle_append
    from readygo.services.recorder.salvage import drop_episodes as drop_episodes
    from readygo.services.recorder.salvage import next_number as next_number
    from readygo.services.recorder.service import attach as attach
else:
    _NAMES = {
        ".config": ("RecorderConfig",),
        ".handlers": (
            "Recorder",
            "handle_append",
        ),
        ".salvage": (
            "drop_episodes",
            "next_number",
        ),
        ".service": ("attach",),
    }
    __all__ = [name for names in _NAMES.values() for name in names]
    __getattr__ = lazy_names(__name__, _NAMES)
