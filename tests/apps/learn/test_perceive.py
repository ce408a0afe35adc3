import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any

import pytest

from readygo.apps.learn import perceive as module
from readygo.apps.learn import perceive_plan, reinforcement
from readygo.apps.learn.perceive import RECORD_SHARE, Step, learn_to_perceive, perception_content
from readygo.apps.learn.perceive_plan import check_plan, read_state
from readygo.apps.learn.plan import lock_folder
from readygo.apps.report.perception import reason
from readygo.common.avatars.cast import load_cast
from readygo.common.errors import RunError
from readygo.common.messages import RunSpec, Split
from readygo.runs.config import config_of, load_run_config, with_mix
from readygo.services.evaluator import EvaluateRequest, Task
from tests.apps.learn.perceive_plans import plan_of
from tests.common.state_policy.state_policies import write_state_policy

do_test = module._test
HELD_OUT = {
    "images": 1, "people": 1, "average_precision": 1.0, "bearing_deg": 1.0, "distance": 0.1, "missed": 0.0,
    "false_per_image": 0.0, "along_r2": 0.5, "across_r2": 0.5, "rays": 0.1,
}  # fmt: skip
METRICS = {"images": 9, "samples_seen": 64, "parameters": 7, "held_out": HELD_OUT}


COUNTS = (24, 70, 172, 206)
"""Episodes of a folder after each recording, where 105 s are for it: 36, 57.5, 93 and 111.5 s are spent then."""


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, object]]:
    """What is asked of recording, training and test.

    The first recording in a folder begins after 30 s, others after 10 s; an episode takes 0.25 s, a training a minute.
    """
    asked: list[tuple[str, object]] = []
    recorded: dict[str, int] = {}
    now_s = [0.0]
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    monkeypatch.setattr(module, "count_recorded", lambda folder: recorded.get(folder.name, 0))

    def record(spec: object, folder: Path, *, episodes: int, workers: int, show: object) -> None:
        asked.append(("record", (folder.name, episodes)))
        had = recorded.get(folder.name, 0)
        now_s[0] += (10.0 if had else 30.0) + 0.25 * (episodes - had)
        recorded[folder.name] = episodes

    def train(folders: list[Path], config: object, out: Path, *, scenes: object, show: object) -> dict[str, object]:
        now_s[0] += 60.0
        asked.append(("train", ([folder.name for folder in folders], config.minutes)))  # type: ignore[attr-defined]
        return METRICS

    def test(plan: object, scene: str, name: str, method: str, episodes: int, tested: object) -> SimpleNamespace:
        asked.append(("test", (scene, name, method, episodes)))
        return SimpleNamespace(summaries={})

    monkeypatch.setattr(module, "record", record)
    monkeypatch.setattr(module, "train_perception", train)
    monkeypatch.setattr(module, "_test", test)
    monkeypatch.setattr(perceive_plan, "VARIANTS", (1, 3))
    monkeypatch.setattr(perceive_plan, "available_cores", lambda: 1)
    return asked


@pytest.fixture
def rl(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The commands of the policy on states, each of which leaves a policy unless the first one is to fail."""
    commands: list[list[str]] = []

    class Process:
        def __init__(self, command: list[str], *, stdout: IO[bytes], **_: object) -> None:
            commands.append(command)
            self.code = 2 if commands[0] == ["fail"] else 0
            if self.code:
                stdout.write(b"Begins\nreadygo: the checkpoint is damaged.\n")
                stdout.flush()
            else:
                write_state_policy(Path(command[command.index("--out") + 1]))

        def wait(self) -> int:
            return self.code

        def poll(self) -> int:
            return self.code

    monkeypatch.setattr(perceive_plan, "available_cores", lambda: 3)
    monkeypatch.setattr(reinforcement, "subprocess", SimpleNamespace(Popen=Process))
    return commands


def test_half_of_the_data_are_crowds_of_varied_people(
    tmp_path: Path, steps: list[tuple[str, object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    specs = {}
    do_record = module.record

    def record(spec: RunSpec, folder: Path, **more: Any) -> None:
        specs[folder.name] = spec
        do_record(spec, folder, **more)

    monkeypatch.setattr(module, "record", record)
    plan = plan_of(tmp_path / "run")
    learn_to_perceive(plan, episodes=0)
    configs = [config_of(spec) for spec in specs.values()]
    assert [config.human_planner for config in configs] == [
        plan.config.human_planner,
        with_mix(plan.config, "crowd").human_planner,
    ]
    assert [config.episode.human_count_min for config in configs] == [plan.config.episode.human_count_min, 2]
    assert {spec.avatars_path for spec in specs.values()} == {str(plan.people)}


def test_time_is_shared_between_recording_and_training(tmp_path: Path, steps: list[tuple[str, object]]) -> None:
    plan = plan_of(tmp_path / "run")
    learned = learn_to_perceive(plan, episodes=2)
    name = steps[0][1][0]  # type: ignore[index]
    assert steps == [
        *(("record", (folder, count)) for folder in (name, f"{name}-crowd") for count in COUNTS),
        ("train", ([name, f"{name}-crowd"], pytest.approx(0.9 * (1 - RECORD_SHARE) * 10))),
        ("test", ("embedded", name, "perceive-and-plan", 2)),
    ]
    assert learned.metrics == METRICS
    assert learned.to_mapping()["method"] == "perceive-and-plan"
    assert len([*(tmp_path / "run" / "people").iterdir()]) == 3


@pytest.mark.parametrize(("minutes", "counts"), [(6, [24, 42, 58]), (3, [24])])
def test_slow_first_episodes_do_not_end_the_recording_while_there_is_time(
    minutes: float, counts: list[int], tmp_path: Path, steps: list[tuple[str, Any]]
) -> None:
    learn_to_perceive(dataclasses.replace(plan_of(tmp_path / "run"), minutes=minutes), episodes=0)
    name = steps[0][1][0]
    assert [asked[1] for step, asked in steps if step == "record" and asked[0] == name] == counts


def test_run_that_goes_on_keeps_its_people(tmp_path: Path, steps: list[tuple[str, object]]) -> None:
    plan = dataclasses.replace(plan_of(tmp_path / "run"), minutes=0.5)
    learn_to_perceive(plan, episodes=0)
    learn_to_perceive(dataclasses.replace(plan, minutes=10), episodes=0)
    assert len([*plan.people.iterdir()]) == read_state(plan)["variants"] == 2


def test_folder_in_which_another_process_learns_is_left_alone(tmp_path: Path, steps: list[tuple[str, object]]) -> None:
    plan = plan_of(tmp_path / "run")
    with lock_folder(plan.out), pytest.raises(RunError, match="Another process is learning in"):
        learn_to_perceive(plan, episodes=0)
    assert steps == []
    check_plan(plan)


def test_run_again_records_as_many_episodes_as_before(tmp_path: Path, steps: list[tuple[str, object]]) -> None:
    plan = plan_of(tmp_path / "run")
    learn_to_perceive(plan, episodes=0)
    name = steps[0][1][0]  # type: ignore[index]
    minutes = read_state(plan)["minutes"]
    steps.clear()
    check_plan(plan)
    learned = learn_to_perceive(plan, episodes=0)
    assert [name for name, _ in steps] == ["record", "record", "train"]
    assert steps[:2] == [("record", (name, COUNTS[-1])), ("record", (f"{name}-crowd", COUNTS[-1]))]
    assert learned.minutes > minutes
    assert not learned.replies


def test_policy_on_states_is_trained_meanwhile_and_the_better_driver_on_val_is_tested(
    tmp_path: Path, steps: list[tuple[str, object]], rl: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(perceive_plan, "available_cores", lambda: 3)
    rates = {"perceive-and-act": 0.6, "perceive-and-plan": 0.4}
    asked = []

    def evaluate(evaluator: object, request: object, *, report: object) -> SimpleNamespace:
        asked.append((request.split, request.methods))  # type: ignore[attr-defined]
        return SimpleNamespace(
            summaries={(Task.DYNAMIC, name): SimpleNamespace(success_rate=rate) for name, rate in rates.items()}
        )

    monkeypatch.setattr(module, "handle_evaluate", evaluate)
    monkeypatch.setattr(module, "evaluation_world", lambda *_, **__: SimpleNamespace(renderer=lambda: None))
    monkeypatch.setattr(module, "make_evaluator", lambda *_, **__: None)
    monkeypatch.setattr(module, "named_methods", lambda *_: {})
    plan = plan_of(tmp_path / "run")
    learned = learn_to_perceive(plan, episodes=2)
    (command,) = rl
    assert command[2:5] == ["readygo", "rl", "embedded"]
    assert command[command.index("--minutes") + 1] == "6"
    assert command[command.index("--train-episodes") + 1] == "1000"
    assert command[command.index("--demonstrations") + 1] == "500"
    assert load_run_config(tmp_path / "run" / "settings.toml").robot == plan.config.robot
    assert learned.method == "perceive-and-act"
    assert learned.val == rates
    assert steps[-1] == ("test", ("embedded", steps[0][1][0], "perceive-and-act", 2))  # type: ignore[index]
    # What was chosen stays chosen, unless a network changes.
    learn_to_perceive(plan, episodes=2)
    assert len(asked) == 1
    text = reason(perception_content(learned, ["embedded"]))
    assert "60 % by perceive-and-act, 40 % by perceive-and-plan" in text


def test_people_of_the_test_are_kept_out_of_all_else(
    tmp_path: Path, steps: list[tuple[str, object]], rl: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Split, Path | None]] = []

    def world(*_: object, avatars: Path | None, seed: int, split: Split = Split.TEST) -> SimpleNamespace:
        asked.append((split, avatars))
        return SimpleNamespace(renderer=lambda: None)

    monkeypatch.setattr(module, "evaluation_world", world)
    monkeypatch.setattr(module, "make_evaluator", lambda *_, **__: None)
    monkeypatch.setattr(module, "named_methods", lambda *_: {})
    rates = {(Task.DYNAMIC, name): SimpleNamespace(success_rate=0.5) for name in module.DRIVERS}
    monkeypatch.setattr(module, "handle_evaluate", lambda *_, **__: SimpleNamespace(summaries=rates))
    monkeypatch.setattr(perceive_plan, "VARIANTS", (6, 6))
    plan = dataclasses.replace(plan_of(tmp_path / "run"), avatars=None)
    content = perception_content(learn_to_perceive(plan, episodes=2), ["embedded"])
    assert {path.name.partition("-")[0] for path in plan.people.iterdir()} == set(load_cast(Path("embedded:train")))
    (command,) = rl
    assert command[command.index("--avatars") + 1] == "embedded:train"
    assert content.unseen
    assert content.commands[0].line.partition(" --avatars ")[2].startswith("embedded:test ")
    for name in ("drive_test", "evaluation_settings", "method_hashes"):
        monkeypatch.setattr(module, name, lambda *_, **__: None)
    do_test(plan, "embedded", "flat", "perceive-and-plan", 1, print)
    assert asked == [(Split.VAL, Path("embedded:train")), (Split.TEST, Path("embedded:test"))]


def test_few_people_walk_in_the_data_and_in_the_test(tmp_path: Path, steps: list[tuple[str, object]]) -> None:
    plan = plan_of(tmp_path / "run")
    assert plan.learned == plan.tested == Path("embedded:test")
    assert not perception_content(learn_to_perceive(plan, episodes=1), ["embedded"]).unseen


def test_policy_on_states_that_fails_ends_the_run_with_its_message(
    tmp_path: Path, steps: list[tuple[str, object]], rl: list[list[str]]
) -> None:
    rl.append(["fail"])
    said = r"^The policy on states was not trained \(exit code 2, .*rl\.log\): the checkpoint is damaged\.$"
    with pytest.raises(RunError, match=said):
        learn_to_perceive(plan_of(tmp_path / "run"), episodes=1)
    # It is found out before anything is recorded.
    assert steps == []


def test_run_without_a_second_core_has_no_choice_of_drivers(tmp_path: Path, steps: list[tuple[str, object]]) -> None:
    learned = learn_to_perceive(plan_of(tmp_path / "run"), episodes=1)
    assert (learned.method, learned.val) == ("perceive-and-plan", {})
    assert "There was no choice" in reason(perception_content(learned, ["embedded"]))


def test_driver_of_several_scenes_is_chosen_by_all_of_them(
    tmp_path: Path, steps: list[tuple[str, object]], rl: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    rates = {"embedded": (0.9, 0.4), "embedded:1": (0.2, 0.3)}
    asked: list[tuple[str, int]] = []

    def evaluate(scene: str, request: EvaluateRequest, *, report: object) -> SimpleNamespace:
        asked.append((scene, request.episodes))
        pairs = zip(module.DRIVERS, rates[scene], strict=True)
        return SimpleNamespace(
            summaries={(Task.DYNAMIC, name): SimpleNamespace(success_rate=rate) for name, rate in pairs}
        )

    monkeypatch.setattr(perceive_plan, "available_cores", lambda: 3)
    monkeypatch.setattr(module, "handle_evaluate", evaluate)
    monkeypatch.setattr(
        module, "evaluation_world", lambda scene, *_, **__: SimpleNamespace(renderer=lambda: None, scene=scene)
    )
    monkeypatch.setattr(module, "make_evaluator", lambda world, **_: world.scene)
    monkeypatch.setattr(module, "named_methods", lambda *_: {})
    learned = learn_to_perceive(plan_of(tmp_path / "run", "embedded", "embedded:1"), episodes=1)
    (command,) = rl
    assert command[2:6] == ["readygo", "rl", "embedded", "embedded:1"]
    assert asked == [("embedded", 15), ("embedded:1", 15)]
    assert learned.val == pytest.approx({"perceive-and-act": 0.55, "perceive-and-plan": 0.35})
    assert learned.method == "perceive-and-act"


def test_report_names_the_commands_that_come_next(tmp_path: Path, steps: list[tuple[str, object]]) -> None:
    learned = learn_to_perceive(plan_of(tmp_path / "run"), episodes=1)
    content = perception_content(learned, ["embedded"])
    assert content.metrics == METRICS
    lines = [command.line for command in content.commands]
    assert lines[0].startswith(f"readygo evaluate embedded --methods perceive-and-plan expert --checkpoints {tmp_path}")
    assert lines[1].startswith(f"readygo train {tmp_path / 'run' / 'data'}/* --recipe perception")
    assert "--form policy" in lines[2]
    assert lines[2].endswith(" --avatars embedded:test --out policy")


def test_progress_is_told(tmp_path: Path, steps: list[tuple[str, object]], monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Step] = []
    do_record = module.record

    def record(spec: RunSpec, folder: Path, **more: Any) -> None:
        more["show"](SimpleNamespace(committed=more["episodes"] // 2, wanted=more["episodes"]))
        do_record(spec, folder, **more)

    monkeypatch.setattr(module, "record", record)
    learn_to_perceive(plan_of(tmp_path / "run"), episodes=0, show=told.append)
    # By the time that is spent: the number of episodes that it allows changes.
    shares = pytest.approx([0.0, 36 / 105, 57.5 / 105, 93 / 105] * 2 + [1.0])
    assert [step.fraction for step in told] == shares
    assert [step.name for step in told] == ["recording"] * 8 + ["reinforcement"]
    told.clear()
    learn_to_perceive(plan_of(tmp_path / "run"), episodes=0, show=told.append)
    assert [step.fraction for step in told] == [0.5, 0.5, 1.0]


@pytest.mark.parametrize(("before", "next_goal"), [(20, 44), (24, 48), (30, 70), (60, 84)])
def test_interrupted_recording_continues_with_its_episodes_or_at_least_some_more(
    before: int, next_goal: int, tmp_path: Path, steps: list[tuple[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, do_record = plan_of(tmp_path / "run"), module.record

    def record(spec: RunSpec, folder: Path, *, episodes: int, **more: Any) -> None:
        do_record(spec, folder, episodes=min(episodes, before), **more)
        if episodes >= before:
            raise KeyboardInterrupt

    monkeypatch.setattr(module, "record", record)
    with pytest.raises(KeyboardInterrupt):
        learn_to_perceive(plan, episodes=0)
    steps.clear()
    monkeypatch.setattr(module, "record", do_record)
    learn_to_perceive(plan, episodes=0)
    counts = [asked[1] for name, asked in steps if name == "record"]
    assert counts[0] == next_goal
    # The other folder was not begun.
    assert tuple(counts[-4:]) == COUNTS
    assert 150 < counts[-5] < 350


@pytest.mark.parametrize("part", ["record", "train_perception"])
def test_time_before_an_interruption_is_counted(
    tmp_path: Path, steps: list[tuple[str, object]], monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    done = getattr(module, part)

    def interrupt(*given: Any, **more: Any) -> None:
        done(*given, **more)
        raise KeyboardInterrupt

    monkeypatch.setattr(module, part, interrupt)
    plan, minutes = plan_of(tmp_path / "run"), []
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            learn_to_perceive(plan, episodes=0)
        minutes.append(read_state(plan)["minutes"])
    assert minutes[1] > minutes[0] > 0
