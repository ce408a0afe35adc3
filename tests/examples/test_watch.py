"""The programs that watch a run keep its pictures."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.fleet.shown import show_newest
from tests.common.dataset.episodes import make_episode

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.parametrize("program", ["watch.py", "watch_zenoh.py"])
def test_program_keeps_the_newest_picture(program: str, tmp_path: Path) -> None:
    header, samples = make_episode(0, 3)
    router = Router(free_endpoint())
    bus = ZenohBus(router.endpoint, "a-run")
    bus.announce("renderer", "r0")
    command = [sys.executable, EXAMPLES / program, router.endpoint, "a-run", tmp_path]
    watcher = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(EXAMPLES.parent)})
    try:
        kept = tmp_path / f"{header.episode.episode_id}.{header.image_format}"
        deadline_s = time.monotonic() + 60
        while not kept.exists() and time.monotonic() < deadline_s:
            show_newest(bus, header, samples)
            time.sleep(0.05)
        time.sleep(0.1)
        assert kept.read_bytes() == samples[-1].image
    finally:
        watcher.terminate()
        watcher.wait()
        bus.close()
        router.close()
