import dataclasses

from readygo.apps.monitor import panels
from readygo.apps.monitor.track import track_of
from readygo.apps.monitor.watch import Seen, Watch
from readygo.common.messages import Outcome
from readygo.common.messages.live import LiveEvaluation, LivePreview
from tests.apps.monitor.test_track import recorded
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
        panels.cameras(watch.workers.values()),
        panels.evaluations(watch),
        panels.moment(track.states[0], track, EVIL),
        panels.picture(b"1", EVIL, EVIL),
    ]
    assert not any("<script" in text for text in shown)
    assert sum("&lt;script" in text for text in shown) >= 5


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
