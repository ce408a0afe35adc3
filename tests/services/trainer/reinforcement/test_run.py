import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import run_episode
from readygo.common.errors import PolicyError
from readygo.common.perception.noise import PERCEIVED
from readygo.common.state_policy.state_driver import StateDriver
from readygo.common.state_policy.state_policy import StatePolicySpec, load_state_policy
from readygo.common.state_simulation.simulation import OUTCOMES, TIMEOUT, StateSimulation
from readygo.common.state_simulation.tracks import tracker_numbers
from readygo.services.trainer.reinforcement.config import PpoConfig, ReinforcementConfig
from tests.common.state_policy.state_policies import TOLD_COUNT, make_state_policy
from tests.common.state_simulation.episodes import Drawn, draw

torch = pytest.importorskip("torch", reason="torch (extra train) is not installed")


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    return draw(8)


def training(drawn: Drawn, out: Path, seed: int = 0, origin: str = "flat", scenes: int = 1):
    from readygo.services.trainer.reinforcement.run import Place, Training

    ppo = PpoConfig(robots=16, stretch=8, minibatches=2, actor_widths=(16,), critic_widths=(16,))
    config = ReinforcementConfig(ppo=ppo, val_every=256, demonstrations=0)
    spec = StatePolicySpec(robot=drawn.world.config.robot, scenes={"0" * 64: "flat"}, noise=PERCEIVED)
    place = Place(world=drawn.state_world, train=drawn.bank, val=drawn.bank.first(4))
    return Training([place] * scenes, spec, config, out, seed=seed, origin=origin)


@pytest.mark.parametrize("scenes", [1, 3])
def test_resumed_training_ends_as_one_without_interruption(drawn: Drawn, tmp_path: Path, scenes: int) -> None:
    from readygo.services.trainer.reinforcement.run import Budget

    rows: list[object] = []
    whole = training(drawn, tmp_path / "whole", scenes=scenes).run(Budget(decisions=1024), rows.append)
    assert len(rows) == 4
    assert whole["decisions"] == 1024
    # The learning rate follows the budget: the same one, interrupted.
    first = training(drawn, tmp_path / "parts", scenes=scenes)

    def interrupt(row) -> None:
        if row["decisions"] >= 512:
            first.save()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        first.run(Budget(decisions=1024), interrupt)
    training(drawn, tmp_path / "parts", scenes=scenes).run(Budget(decisions=1024))
    told = np.random.default_rng(0).normal(size=(5, TOLD_COUNT)).astype(np.float32)
    one, two = (load_state_policy(tmp_path / name) for name in ("whole", "parts"))
    assert np.array_equal(one.logits(told), two.logits(told))
    assert one.spec.training["chosen"] == two.spec.training["chosen"]


def test_validation_drives_as_the_drivers_do_which_do_not_wait_forever(drawn: Drawn) -> None:
    from readygo.services.trainer.reinforcement.run import play

    policy = make_state_policy()
    waits = (policy.commands == 0.0).all(axis=1)
    policy.layers[-1][1][:] = np.where(waits, np.float32(1e6), np.float32(0.0))
    numbers = tracker_numbers(PERCEIVED, drawn.world.config.robot.clock)
    fast = StateSimulation(drawn.state_world, drawn.bank, numbers, len(drawn.bank), knows_truth=False)
    outcomes = play(policy, fast, dynamic=False)
    config, robot_map = drawn.world.config, drawn.world.scene.maps.robot
    for code, (scenario, motions) in zip(outcomes, drawn.pairs, strict=True):
        alone = dataclasses.replace(scenario, humans=())
        still = dataclasses.replace(motions, humans=())
        one = EpisodeSimulation(alone, still, robot_map, config.robot, config.episode)
        run_episode(one, StateDriver(policy, drawn.state_world, drawn.distances))
        assert OUTCOMES[code] is one.outcome
    assert TIMEOUT not in outcomes


def test_folder_has_policy_metrics_curve_and_chart(drawn: Drawn, tmp_path: Path) -> None:
    from readygo.services.trainer.reinforcement.run import Budget

    metrics = training(drawn, tmp_path).run(Budget(decisions=512))
    assert json.loads((tmp_path / "metrics.json").read_text()) == metrics
    curve = [json.loads(line) for line in (tmp_path / "curve.jsonl").read_text().splitlines()]
    assert [row["decisions"] for row in curve] == [256, 512]
    assert {"val_static", "val_dynamic", "train_human", "entropy"} <= set(curve[0])
    assert "<svg" in (tmp_path / "curve.svg").read_text()
    assert load_state_policy(tmp_path).spec.training["chosen"]["decisions"] == metrics["chosen_decisions"]


def test_other_settings_or_episodes_do_not_continue_a_training(drawn: Drawn, tmp_path: Path) -> None:
    from readygo.services.trainer.reinforcement.run import Budget

    training(drawn, tmp_path).run(Budget(decisions=128))
    for other in ({"seed": 1}, {"origin": "another flat"}):
        with pytest.raises(PolicyError, match="other settings, seed, scene, robot or people"):
            training(drawn, tmp_path, **other)
    training(drawn, tmp_path)


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[: len(data) // 2],
        lambda data: b"",
        lambda data: b"no checkpoint",
    ],
    ids=["truncated", "empty", "garbage"],
)
def test_damaged_checkpoint_is_refused(drawn: Drawn, tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    training(drawn, tmp_path).save()
    path = tmp_path / "checkpoint.pt"
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(PolicyError, match=r"checkpoint\.pt is damaged"):
        training(drawn, tmp_path)


@pytest.mark.parametrize(
    "change",
    [
        lambda state: state.pop("identity"),
        lambda state: state["learner"].clear(),
        lambda state: state["progress"].update(more=1),
        lambda state: state["robots"].popitem(),
    ],
    ids=["no identity", "no learner", "unknown progress", "fewer robots"],
)
def test_checkpoint_with_other_content_is_refused(
    drawn: Drawn, tmp_path: Path, change: Callable[[dict[str, Any]], object]
) -> None:
    from readygo.services.trainer.checkpoint import read_state, write_state

    training(drawn, tmp_path).save()
    path = tmp_path / "checkpoint.pt"
    state = read_state(path)
    change(state)
    write_state(state, path)
    with pytest.raises(PolicyError, match=r"checkpoint\.pt is damaged"):
        training(drawn, tmp_path)


def test_first_policy_has_a_checkpoint_beside_it(drawn: Drawn, tmp_path: Path) -> None:
    from readygo.services.trainer.reinforcement.run import Budget

    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    first = training(drawn, tmp_path)
    with pytest.raises(KeyboardInterrupt):
        first.run(Budget(decisions=1024), interrupt)
    assert (tmp_path / "state_policy.toml").exists()
    assert training(drawn, tmp_path).progress == first.progress


def test_budget_is_spent_by_decisions_or_by_minutes() -> None:
    from readygo.services.trainer.reinforcement.run import Budget

    assert Budget(decisions=200).share(50, 9e9) == 0.25
    assert Budget(minutes=2.0).share(10**12, 30.0) == 0.25
    assert Budget(minutes=2.0).share(0, 500.0) == 1.0
