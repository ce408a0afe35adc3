"""The recorder: acknowledged samples in, durable MCAP shards out."""

from services.recorder.config import RecorderConfig
from services.recorder.handlers import Recorder, handle_append
from services.recorder.service import attach

__all__ = ["Recorder", "RecorderConfig", "attach", "handle_append"]
