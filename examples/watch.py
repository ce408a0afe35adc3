"""Saves the newest image of every renderer of a run as a file: python watch.py ENDPOINT RUN FOLDER."""

import os
import sys
import time
from pathlib import Path

from readygo.common.bus.zenoh_bus import ZenohBus
from readygo.common.messages import topics
from readygo.common.messages.live import LivePreview

endpoint, run, folder = sys.argv[1:]


def keep(preview: LivePreview) -> None:
    """Write a renderer's newest image to a file."""
    (Path(folder) / f"{preview.episode.episode_id}.{preview.format}").write_bytes(preview.image)


bus = ZenohBus(endpoint, run, os.environ.get("READYGO_TOKEN", ""))
bus.subscribe(topics.PREVIEW.of(), keep)
while True:
    time.sleep(1)
