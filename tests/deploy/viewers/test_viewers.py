"""Layout and blueprint name what is in shards."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from readygo.common.dataset import schemas
from readygo.common.dataset.stage import Scenery
from tests.common.dataset.episodes import ROBOT, write_shard

VIEWERS = Path(__file__).parents[3] / "deploy" / "viewers"
TOPICS = {channel.topic: channel for channel in schemas.staged_channels(schemas.OPTIONAL_CHANNELS)}


def test_foxgloves_layout_names_topics_and_fields_of_shards() -> None:
    layout = json.loads((VIEWERS / "foxglove.json").read_text())
    panels = layout["configById"]
    image = panels["Image!camera"]["imageMode"]
    assert {*panels["3D!scene"]["topics"], image["imageTopic"], image["calibrationTopic"]} <= set(TOPICS)
    assert panels["3D!scene"]["followTf"] == schemas.ROBOT_FRAME
    for path in panels["Plot!action"]["paths"]:
        topic, field = path["value"].split(".")
        assert field in TOPICS[topic].message.DESCRIPTOR.fields_by_name
    placed = re.findall(r'"([A-Z0-9a-z]+![a-z]+)"', json.dumps(layout["layout"]))
    assert set(placed) == set(panels)


def test_reruns_view_names_topics_of_shards() -> None:
    named = re.findall(r'"[-+ ]*(/[a-z]+(?:/[a-z_]+)*)"', (VIEWERS / "rerun_view.py").read_text())
    assert named
    assert set(named) <= set(TOPICS)


def test_reruns_view_is_written(tmp_path) -> None:
    pytest.importorskip("rerun", reason="needs rerun-sdk, which readygo does not depend on")
    shard, out = write_shard(tmp_path, [0], stage=Scenery(robot=ROBOT)), tmp_path / "view.rrd"
    command = [sys.executable, str(VIEWERS / "rerun_view.py"), str(shard), "--save", str(out)]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    assert out.stat().st_size > 20_000
