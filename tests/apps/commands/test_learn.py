import dataclasses
import json
import sys
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.__main__ import main
from readygo.apps.commands import learn as command
from readygo.apps.commands.learn import LearnOptions, LearnTrainingOptions, learn, line_of
from readygo.apps.fleet.options import RouterOptions
from readygo.apps.learn.choice import PolicyMeasurement
from readygo.apps.learn.perceive import Step
from readygo.apps.learn.perceive_plan import FORMAT, STATE_FILE
from readygo.apps.learn.supervise import Now
from readygo.runs.scene_argument import open_scene
from tests.common.state_policy.state_policies import write_state_policy


def test_line_says_what_is_known() -> None:
    early = Now(fraction=0, minutes=0.1, samples=6004, images=1200, learned=0, policies=0, driven=None, latest=None)
    assert line_of(early) == "0.1 min, 6,004 samples recorded, 1,200 with an image, 0 learned from, 0 policies"
    latest = PolicyMeasurement(fraction=0.1, policy="ab", episodes=8, static=0.5, dynamic=0.25)
    late = dataclasses.replace(early, images=30_000, learned=135_000, policies=4, driven=0.42, latest=latest)
    assert ", 135,000 learned from (4.5 times each), 4 policies, driving SR 42 %, val SR 50 / 25 %" in line_of(late)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["embedded", "--minutes", "0"], "--minutes must be above 0 and at most 100000, got 0."),
        (["embedded", "--minutes", "1e300"], "--minutes must be above 0 and at most 100000, got 1e+300."),
        (["embedded", "--samples", "-3"], "--samples must be at least 1, got -3."),
        (["embedded", "--episodes", "-1"], "--episodes must be at least 0, got -1."),
        (["nowhere"], "nowhere does not exist; make one with"),
        (["nowhere", "--form", "policy"], "nowhere does not exist; make one with"),
        (["embedded", "--form", "policy", "--minutes", "0"], "--minutes must be above 0 and at most 100000, got 0."),
        (["embedded", "--form", "perceive", "--inputs", "rgb"], "perceive takes no --inputs."),
        (["embedded", "--form", "perceive", "--learn.mix", "0.5"], "perceive takes no --learn.mix."),
        (["embedded", "--form", "perceive", "--teacher", "rl"], "perceive takes no --teacher."),
        (["embedded", "--form", "paper", "--teacher", "rl"], "--form paper takes no --teacher."),
        (["embedded", "--form", "paper", "--on", "hosts"], "--form paper takes no --on."),
        (["embedded", "--form", "paper", "--minutes", "0"], "--minutes must be above 0 and at most 100000, got 0."),
        (["embedded", "--form", "paper", "--learn.goal", "image"], "--form paper goes with the rgb of one camera"),
        (["embedded", "--learn.memory", "-3"], "--learn.memory must be at least 0 and at most 1024, got -3."),
        (["embedded", "--learn.teacher", "me"], "--learn.teacher must be rl or expert or expert-tracked, got 'me'"),
        (
            ["embedded", "--teacher", "rl", "--learn.teacher", "expert"],
            '--teacher is rl, and learn.teacher is "expert": leave one of them out.',
        ),
        (
            ["embedded", "--form", "paper", "--learn.teacher", "expert-tracked", "--expert.mode", "paper"],
            'The teacher expert-tracked tracks people, and the expert of mode "paper" takes bodies: set mode',
        ),
        (["nowhere", "--form", "paper"], "nowhere does not exist; make one with"),
        (["embedded", "--teacher", "nowhere"], "--teacher: nowhere holds no state policy; train one"),
    ],
)
def test_what_makes_no_sense_is_one_line_and_leaves_nothing(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.setattr(sys, "argv", ["readygo", "learn", *arguments, "--out", str(tmp_path / "run")])
    with pytest.raises(SystemExit) as exit_info:
        main()
    assert exit_info.value.code == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1
    assert not (tmp_path / "run").exists()


@pytest.fixture
def wired(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """What the parts of the command are asked for, by their names."""
    asked = {}
    place = SimpleNamespace(folder=SimpleNamespace(state=tmp_path / "state"))
    plan = SimpleNamespace(policy=tmp_path / "policy", places=[place])
    learned = SimpleNamespace(replies={}, to_mapping=lambda: {"done": 1})

    def note(name, result):
        return lambda *words, **more: (asked.setdefault(name, (words, more)), result)[1]

    for name, result in (
        ("learn_configs", ("robot", "settings")),
        ("make_plan", plan),
        ("learn_policy", learned),
        ("report_content", "content"),
        ("write_report", None),
        ("show_page", nullcontext()),
        ("identity_for", None),
    ):
        monkeypatch.setattr(command, name, note(name, result))
    return asked, plan, learned


def test_command_passes_on_what_it_is_told(wired, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked, plan, learned = wired
    keys = {"renderer": {"goal_image": True}}
    out, config, robot, certs = (tmp_path / name for name in ("run", "a.toml", "robot.toml", "certs"))
    learn(
        LearnOptions(
            scenes=("one", "two"), out=out, minutes=7.0, episodes=4, seed=3, robot=robot, config=config,
            inputs="rgb,depth", on="hosts", watch=True, json=True, keys=keys,
            training=LearnTrainingOptions(
                samples=900,
                avatars=tmp_path,
                cameras="left",
                goal="image",
                teacher=tmp_path / "rl",
                perception=tmp_path / "perception",
            ),
            fleet=RouterOptions(listen="tls/lab:1", certs=certs),
        )
    )  # fmt: skip
    assert asked["identity_for"] == (("tls/lab:1", "coordinator"), {"certs": certs})
    words, more = asked["learn_configs"]
    assert words == (config, robot, "rgb,depth", "left", "image")
    assert more == {"scene_count": 2, "perception": tmp_path / "perception", "keys": keys}
    words, more = asked["make_plan"]
    assert words[:4] == (("one", "two"), out, "robot", "settings")
    assert (words[4].minutes, words[4].samples) == (7.0, 900)
    folders = {"teacher": tmp_path / "rl", "perception": tmp_path / "perception"}
    assert more == {"avatars": tmp_path, "seed": 3, "people": None, **folders}
    (where, begun, by), _ = asked["show_page"]
    assert (where, by) == (out, certs)
    assert not begun()
    plan.places[0].folder.state.mkdir()
    (plan.places[0].folder.state / "endpoint").touch()
    assert begun()
    words, more = asked["learn_policy"]
    assert (words, more["episodes"]) == ((plan,), 4)
    assert (more["reach"].listen, more["reach"].certs, more["reach"].hosts) == ("tls/lab:1", certs, True)
    given = {"--episodes": "4", "--seed": "3", "--robot": str(robot), "--config": str(config)}
    given |= {"--inputs": "rgb,depth", "--goal": "image", "--avatars": str(tmp_path), "--cameras": "left"}
    given |= {f"--{name}": str(folder) for name, folder in folders.items()}
    assert asked["report_content"] == ((learned, ("one", "two"), given | {"--renderer.goal-image": "true"}), {})
    assert asked["write_report"] == ((out / "report.html", "content"), {})
    said = capsys.readouterr()
    assert json.loads(said.out) == {"done": 1}
    assert said.err == "More workers can join: readygo worker all --connect tls/lab:1 --certs CERTS\n"


def test_command_on_this_machine_is_neither_watched_nor_joined(wired, tmp_path: Path, capsys) -> None:
    asked, plan, _ = wired
    learn(LearnOptions(scenes=(), out=tmp_path / "run", form="policy"))
    assert set(asked) == {"learn_configs", "make_plan", "learn_policy", "report_content", "write_report"}
    assert asked["learn_configs"][1] == {"scene_count": 1, "perception": None, "keys": {}}
    assert asked["report_content"][0][2] == {"--form": "policy"}
    reach = asked["learn_policy"][1]["reach"]
    assert (reach.listen, reach.hosts) == ("", False)
    said = capsys.readouterr().out
    assert f"The policy: {plan.policy}. How it learned and what it fails in: {tmp_path / 'run' / 'report.html'}" in said
    learn(LearnOptions(scenes=("one",), out=tmp_path / "run", fleet=RouterOptions(listen="tcp/lab:1")))
    token = f"READYGO_TOKEN=$(tail -1 {tmp_path / 'state' / 'endpoint'}) "
    assert f"More workers can join: {token}readygo worker all --connect tcp/lab:1\n" in capsys.readouterr().err


@pytest.mark.parametrize("form", ["auto", "perceive"])
def test_without_options_of_policies_perception_is_learned(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = {}
    learned = SimpleNamespace(replies={}, method="perceive-and-act", to_mapping=lambda: {"done": 2})

    def run(plan, **more):
        asked["plan"], asked["episodes"] = plan, more["episodes"]
        return learned

    monkeypatch.setattr(command, "check_plan", lambda plan: None)
    monkeypatch.setattr(command, "learn_to_perceive", run)
    monkeypatch.setattr(command, "perception_content", lambda *_: "content")
    monkeypatch.setattr(command, "reason", lambda content: f"The reason of {content}.")
    monkeypatch.setattr(command, "write_perception_report", lambda path, content: asked.update(report=(path, content)))
    out = tmp_path / "run"
    training = LearnTrainingOptions(avatars=tmp_path)
    learn(LearnOptions(scenes=("one",), out=out, form=form, minutes=3.0, episodes=5, seed=2, training=training))
    plan = asked["plan"]
    assert (plan.out, plan.scenes, plan.minutes, plan.seed, plan.avatars) == (out, ("one",), 3.0, 2, tmp_path)
    assert asked["episodes"] == 5
    assert asked["report"] == (out / "report.html", "content")
    said = capsys.readouterr().out
    assert f"The network: {out / 'perception'}. It drives as the method perceive-and-act.\n" in said
    assert f"The reason of content. All of it: {out / 'report.html'}\n" in said
    keys = {"renderer": {"detail": "exact"}}
    learn(LearnOptions(scenes=("one",), out=out, form=form, json=True, keys=keys))
    assert asked["plan"].config.renderer.detail == "exact"
    assert json.loads(capsys.readouterr().out) == {"done": 2}


@pytest.fixture
def first(monkeypatch: pytest.MonkeyPatch):
    """Runs of the form perceive that were asked for; each leaves a policy on states, and spends two minutes."""
    plans = []

    def run(plan, **more):
        plans.append((plan, more["episodes"]))
        (plan.out / "data" / "embedded").mkdir(parents=True)
        write_state_policy(plan.out / "rl")
        (plan.out / STATE_FILE).write_text(json.dumps({"format": FORMAT, "scenes": [], "minutes": 2.0}))

    monkeypatch.setattr(command, "learn_to_perceive", run)
    monkeypatch.setattr(command, "perception_content", lambda *_: "perceived")
    monkeypatch.setattr(command, "write_perception_report", lambda path, content: path.write_text(content))
    return plans


def test_form_of_the_paper_learns_to_perceive_first_and_then_from_that(wired, first, tmp_path: Path) -> None:
    asked, out = wired[0], tmp_path / "run"
    training = LearnTrainingOptions(avatars=Path("embedded:train"))
    options = LearnOptions(
        scenes=("embedded",), out=out, form="paper", minutes=6.0, seed=2, training=training,
        keys={"learn": {"mix": 0.5}, "renderer": {"detail": "exact"}},
    )  # fmt: skip
    learn(options)
    ((plan, episodes),) = first
    assert (plan.out, plan.minutes, plan.seed, episodes) == (out / "perceive", pytest.approx(2.4), 2, 0)
    assert (plan.avatars, plan.config.renderer.detail) == (Path("embedded:train"), "exact")
    assert (plan.config.robot.camera.height_px, plan.config.robot.camera.width_px) == (72, 128)
    assert (out / "perceive" / "report.html").read_text() == "perceived"
    words, more = asked["make_plan"]
    # What the first part left of the six minutes, less those of the third.
    assert words[4].minutes == pytest.approx(2.2)
    refine = asked["learn_policy"][1]["refine"]
    assert (refine.func, refine.args[0]) == (command.refine, wired[1])
    assert refine.keywords == {"before": [out / "perceive" / "data" / "embedded"], "minutes": pytest.approx(1.8)}
    assert (more["perception"], more["teacher"]) == (plan.out / "perception", plan.out / "rl")
    assert (more["people"], more["avatars"]) == (plan.out / "people", Path("embedded:train"))
    assert asked["learn_configs"][1]["keys"] == {**options.keys, "learn": {"mix": 0.5, "memory": 0}}
    assert asked["report_content"][0][2] == {
        "--form": "paper", "--seed": "2", "--avatars": "embedded:train", "--minutes": "12",
        "--learn.mix": "0.5", "--renderer.detail": "exact",
    }  # fmt: skip


def test_expert_teaches_in_the_form_of_the_paper_where_it_is_told_to(wired, first, tmp_path: Path) -> None:
    keys = {"learn": {"teacher": "expert"}}
    learn(LearnOptions(scenes=("embedded",), out=tmp_path / "run", form="paper", minutes=6.0, keys=keys))
    ((plan, _),) = first
    assert not plan.policy_on_states
    more = wired[0]["make_plan"][1]
    assert (more["perception"], more["teacher"]) == (plan.out / "perception", None)


@pytest.mark.parametrize("form", ["auto", "paper"])
def test_second_part_of_the_form_of_the_paper_goes_on_without_the_first(
    form: str, wired, first, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "run"
    write_state_policy(out / "perceive" / "rl")
    (out / "perceive" / "data").mkdir()
    state = {"format": FORMAT, "scenes": [open_scene("embedded").content_hash], "minutes": 2.7}
    (out / "perceive" / STATE_FILE).write_text(json.dumps(state))
    (out / "learn.json").write_text("{}")
    learn(LearnOptions(scenes=("embedded",), out=out, form=form, minutes=6.0))
    assert first == []
    assert wired[0]["make_plan"][0][4].minutes == pytest.approx(1.5)
    assert wired[0]["make_plan"][1]["people"] == out / "perceive" / "people"


def test_run_of_a_policy_goes_on_as_one(wired, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "learn.json").write_text("{}")
    learn(LearnOptions(scenes=("one",), out=tmp_path / "run"))
    assert "learn_policy" in wired[0]


def test_robot_of_ranges_learns_a_policy(wired, tmp_path: Path) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text("[ranges]\nradius_m = [0.2, 0.3]\n")
    learn(LearnOptions(scenes=("one",), out=tmp_path / "run", robot=robot))
    assert "learn_policy" in wired[0]


def test_section_of_policies_in_the_configuration_learns_one(wired, tmp_path: Path) -> None:
    config = tmp_path / "a.toml"
    config.write_text("[learn]\nmix = 0.5\n")
    learn(LearnOptions(scenes=("one",), out=tmp_path / "run", config=config))
    assert "learn_policy" in wired[0]


def test_bars_of_learning_and_of_the_test_are_shown_one_after_the_other(capsys: pytest.CaptureFixture[str]) -> None:
    now = Now(fraction=0.25, minutes=2.0, samples=50, images=10, learned=20, policies=1, driven=None, latest=None)
    with command.live_line(12) as (show, show_step, tested):
        show(now)
        tested(SimpleNamespace(task=SimpleNamespace(value="static"), method="expert"))
        tested(SimpleNamespace(task=SimpleNamespace(value="dynamic"), method="policy"))
    said = capsys.readouterr().err.splitlines()[-1]
    assert said == f"learning  25% {line_of(now)}; test  17% dynamic, policy"
    with command.live_line(12) as (show, show_step, tested):
        show(now)
        show_step(Step(name="perception", fraction=0.5, words="loss 0.10"))
    assert capsys.readouterr().err.splitlines()[-1] == "perception  50% loss 0.10"
