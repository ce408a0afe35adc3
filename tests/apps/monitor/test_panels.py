import dataclasses
import re

from readygo.apps.monitor import panels
from readygo.apps.monitor.track import track_of
from readygo.apps.monitor.watch import Seen, Watch
from readygo.common.messages import Outcome
from readygo.common.messages.live import LiveEvaluation, LivePreview
from readygo.common.robot import RobotConfig
from tests.apps.monitor.test_track import TWO_CAMERAS, recorded, recorded_by_two
from tests.apps.monitor.watched import status

EVIL = "<script>alert(1)</script>"


def test_what_others_say_is_text(spec) -> None:
    watch = Watch()
    watch.connection = EVIL
    watch.status = status(rejected={EVIL: 2}, trouble=EVIL, kept={EVIL: 1})
    watch.workers["renderer", EVIL] = Seen(role="renderer", name=EVIL, trouble=EVIL, stage=EVIL)
    track = track_of(recorded())
    key = track.episode
    watch.workers["renderer", EVIL].preview = LivePreview(episode=key, time_ns=0, format=EVIL, image=b"1")
    watch.evaluations.append(
        LiveEvaluation(episode=key, task=EVIL, method=EVIL, policy="", outcome=Outcome.SUCCESS, duration_s=1.0)
    )
    shown = [
        panels.header(EVIL, watch, 0, EVIL),
        panels.stages(watch.status, spec),
        panels.workers(watch),
        panels.cameras(watch.workers.values(), RobotConfig()),
        panels.evaluations(watch),
        panels.moment(track.states[0], track, EVIL),
        panels.pictures({"rgb": b"1", f"{EVIL}.rgb": b"1"}, EVIL, RobotConfig()),
    ]
    assert not any("<script" in text for text in shown)
    assert sum("&lt;script" in text for text in shown) >= 5


def test_every_camera_of_a_renderer_is_shown_from_left_to_right_with_depths_below() -> None:
    sample = recorded_by_two().samples[0]
    preview = LivePreview(
        episode=recorded().header.episode, time_ns=0, format="jpeg", image=sample.image, outputs=sample.outputs
    )
    seen = Seen(role="renderer", name="render0", preview=preview)
    text = panels.cameras([seen], TWO_CAMERAS)
    assert re.findall("<figcaption>(.*?)</figcaption>", text) == ["left", "front", "left depth"]
    assert text.count("data:image/jpeg") == 3, "a browser would show the depths' own file all but black"
    assert "<figcaption" not in panels.cameras(
        [dataclasses.replace(seen, preview=dataclasses.replace(preview, outputs={}))], RobotConfig()
    )


def test_header_says_how_the_run_is() -> None:
    watch = Watch()
    assert "live" in panels.header("run", watch, 0)
    watch.connection = "No router answers."
    assert "waiting for the fleet" in panels.header("run", watch, 0)
    assert "No router answers." in panels.header("run", watch, 0)
    assert "recorded" in panels.header("run", watch, 7)
    watch.status = status(finished=True)
    assert "complete" in panels.header("run", watch, 7)
    watch.status = status(failed="the disk is full")
    assert "the disk is full" in panels.header("run", watch, 7)


def test_charts_and_bars_have_the_numbers(spec) -> None:
    watch = Watch()
    for second in range(5):
        watch.progress.add(second, (100.0 * second, second, 3, 1, 1, 0))
    assert panels.charts(watch).count("<svg") == 2
    text = panels.stages(status(), spec)
    assert "1 + 3" in text, "one at work, three waiting"
    assert "no path" in text
    assert panels.stages(None, spec) == ""


def test_moment_says_who_is_near() -> None:
    track = track_of(recorded())
    state = dataclasses.replace(track.states[0], human_distance_m=float("inf"))
    assert "nobody" in panels.moment(state, track)
    assert "success" in panels.moment(state, track)
    assert "under way" in panels.moment(state, None, "render0")
