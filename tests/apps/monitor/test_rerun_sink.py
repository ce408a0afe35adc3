import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.monitor.feed import LiveMoment
from readygo.apps.monitor.track import track_of
from readygo.common.errors import RunError
from tests.apps.monitor.test_page import house
from tests.apps.monitor.test_track import TWO_CAMERAS, recorded_by_two
from tests.common.perception.test_live import perception

rerun = pytest.importorskip("rerun", reason="rerun-sdk is not installed: readygo[rerun]")


def test_a_recording_has_robot_humans_images_and_numbers(tmp_path: Path) -> None:
    from readygo.apps.monitor.rerun_sink import RerunSink

    file = tmp_path / "seen.rrd"
    sink = RerunSink(TWO_CAMERAS, house(), str(file))
    track = track_of(recorded_by_two())
    way = np.array([state.robot_xyzyaw for state in track.states])
    for state in track.states[:3]:
        images = track.images_at(state.time_ns / 1e9)
        moment = LiveMoment(state=state, images=images, way=way, perception=perception())
        sink.begin(moment, state.time_ns)
        sink.show(moment, state.time_ns)
    sink.close()
    command = [sys.executable, "-m", "rerun", "rrd", "print", str(file)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    for entity in ("/world/scene", "/world/robot", "/world/humans", "/numbers/speed_mps"):
        assert entity in printed, entity
    for name in ("humans", "tracks", "velocities", "free"):
        assert f"/world/perceived/{name}" in printed, name
    for entity in ("/world/robot/camera", "/world/robot/camera_left", "/world/robot/camera_left/depth"):
        assert entity in printed, entity


def test_viewer_that_cannot_be_is_refused() -> None:
    from readygo.apps.monitor.rerun_sink import RerunSink

    with pytest.raises(RunError, match="--rerun nonsense"):
        RerunSink(TWO_CAMERAS, None, "nonsense")
