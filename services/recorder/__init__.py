"""The recorder: acknowledged samples in, durable MCAP shards out."""

from readygo.services.recorder.config import RecorderConfig
from readygo.services.recorder.handlers import Recorder, handle_append
from readygo.services.recorder.service import attach

__all__ = ["Recorder", "RecorderConfig", "attach", "handle_append"]
