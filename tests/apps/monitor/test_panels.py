import dataclasses
import re
from collections.abc import Callable

import numpy as np

from readygo.apps.monitor import panels
from readygo.apps.monitor.track import track_of
from readygo.apps.monitor.watch import RunWatch, Seen
from readygo.common.drawing.charts import Curve
from readygo.common.messages import DriverKind, Outcome
from readygo.common.messages.live import LiveEvaluation, LivePreview
from readygo.common.robot import RobotConfig
from tests.apps.monitor.test_track import TWO_CAMERAS, recorded, recorded_by_two
from tests.apps.monitor.watched import status

EVIL = "<script>alert(1)</script>"


def test_what_others_say_is_text(spec) -> None:
    watch = RunWatch()
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
    watch = RunWatch()
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
    watch = RunWatch()
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
    assert "none" in panels.moment(state, track)
    assert "success" in panels.moment(state, track)
    assert "under way" in panels.moment(state, None, "render0")


def test_panels_look_as_they_did(spec, golden_page: Callable[[str, str], None]) -> None:
    now_s = [500.0]
    watch = RunWatch(lambda: now_s[0])
    parts = {"begun": panels.header("flat", watch, 0)}
    watch.connection = "No <router> answers."
    parts |= {
        "recorded": panels.header("flat", watch, 1234, "Its scene is gone."),
        "lost": panels.header("a", watch, 0),
    }
    watch.connection = ""
    counts = {
        "wanted": 1300, "committed": 417, "samples": 98_765, "requeued": 3, "trouble": "full & read-only",
        "waiting": {"human-plan": 7, "render": 2}, "leased": {"render": 5, "animate": 1},
        "rejected": {"no_path": 12, "timeout": 30} | {f"r{k}": k for k in range(1, 9)}, "kept": {"human_collision": 4},
        "cpu_s": {"render": 75.0, "animate": 25.0, "human-plan": 12.5},
    }  # fmt: skip
    watch.status = status(**counts)
    for k in range(30):
        watch.progress.add(10.0 * k, (137.0 * k, 2.0 * k, 40 - k, k % 7, 0, 0))
    parts |= {"header": panels.header("flat", watch, 0), "stages": panels.stages(watch.status, spec)}
    parts |= {"without a spec": panels.stages(watch.status, None), "charts": panels.charts(watch)}
    watch.connection = "gone"
    parts["waiting"] = panels.header("flat", watch, 0)
    few = RunWatch()
    for k in range(4):
        few.progress.add(2.0 + 45.0 * k, (7.0 * k, 0, 3, k, 0, 0))
    parts |= {"seconds": panels.charts(few), "nothing": panels.charts(RunWatch())}
    losses = [Curve(name="training", x=np.array([10.0, 500.0]), y=np.array([2.0, 1.5]))]
    rates = [Curve(name="driving", x=np.array([1.0, 9.0]), y=np.array([0.2, 0.7]))]
    parts["learning"] = panels.learning(losses, rates)
    key = recorded().header.episode
    for policy, method, outcome in (
        ("", "expert", Outcome.SUCCESS), ("ab" * 32, "policy", Outcome.TIMEOUT), ("ab" * 32, "policy", Outcome.SUCCESS),
        ("ab" * 32, "policy", Outcome.SUCCESS), ("cd" * 32, "policy", Outcome.STATIC_COLLISION),
    ):  # fmt: skip
        watch.evaluations.append(
            LiveEvaluation(episode=key, task="static", method=method, policy=policy, outcome=outcome, duration_s=1.0)
        )
    parts["evaluations"] = panels.evaluations(watch)
    members = [
        Seen(role="renderer", name="r1", stage="render", episode=key, since_s=463.4, done=1200, cpu_s=1234.5),
        Seen(role="renderer", name="r0", stage="warm", since_s=499.0, memory_bytes=1_234_567_890),
        Seen(role="animator", name="z", alive=False, stage="animate", trouble="it <fell>"),
        Seen(role="animator", name="y", trouble="late"),
        Seen(role="animator", name="x"),
    ]
    watch.workers = {(seen.role, seen.name): seen for seen in members}
    parts |= {"workers": panels.workers(watch), "nobody": panels.workers(RunWatch())}
    text = "\n\n".join(f"{name}: {part}" for name, part in parts.items())
    golden_page("monitor_panels", text.replace("</div>", "</div>\n"))


def test_moments_look_as_they_did(golden_page: Callable[[str, str], None]) -> None:
    track = track_of(recorded())
    state = dataclasses.replace(
        track.states[2], time_ns=1_234_000_000, v_mps=-0.237, w_radps=0.456, driver=DriverKind.POLICY,
        goal_xy_m=(3.0, -4.0), robot_xyzyaw=(-1.0, 1.5, 0.2, 2.5), human_distance_m=1.26, time_to_collision_s=2.34,
    )  # fmt: skip
    ended = [dataclasses.replace(track, outcome=outcome) for outcome in Outcome]
    texts = [panels.moment(state, None, "render<0>"), *(panels.moment(state, one) for one in ended)]
    preview = LivePreview(episode=track.episode, time_ns=2_340_000_000, format="png", image=b"png")
    texts.append(
        panels.cameras([Seen(role="r", name="r<0>", preview=preview), Seen(role="r", name="b")], RobotConfig())
    )
    texts += [panels.cameras([], TWO_CAMERAS), panels.pictures({"rgb": b"1"}, "gif", RobotConfig())]
    assert panels.pictures({}, "jpeg", RobotConfig()) == ""
    golden_page("monitor_moments", "\n\n".join(texts).replace("</div>", "</div>\n"))
