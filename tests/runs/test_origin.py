import dataclasses
import shutil
from pathlib import Path

import pytest

from readygo.common.avatars.file import EMBEDDED_FOLDER
from readygo.common.camera import SensorConfig
from readygo.common.errors import PolicyError
from readygo.common.messages import RunSpec, Split
from readygo.common.policy import PolicySpec, load_spec, save_spec
from readygo.common.robot import RobotConfig
from readygo.runs.config import RunConfig, load_run_config
from readygo.runs.origin import (
    DataOrigin,
    avatars_of_policy,
    check_unseen,
    note_origin,
    origin_of_policy,
    origin_of_runs,
    robot_of_policy,
    settings_of_policy,
    unseen_avatars,
    with_origin,
)
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.services.planner.humans.config import HumanPlannerConfig
from readygo.services.renderer import RendererConfig

SPEC = PolicySpec(robot=RobotConfig(height_m=0.8), sensor=SensorConfig(k1=(0.0, 0.02)), training={"seed": 3})


def run_of(config: RunConfig, avatars: Path | None, *, static: bool = False) -> RunSpec:
    return make_spec(open_scene("embedded"), avatars, config, seed=0, split=Split.TRAIN, static=static)


@pytest.fixture
def avatars(tmp_path: Path) -> Path:
    folder = tmp_path / "people of here"
    folder.mkdir()
    for name in ("amara", "bruno"):
        shutil.copy(EMBEDDED_FOLDER / f"{name}.npz", folder)
    return folder


@pytest.fixture
def policy(avatars: Path, tmp_path: Path) -> Path:
    """A policy of data with two humans, drawn with levels of detail."""
    save_spec(SPEC, tmp_path)
    config = load_run_config(None, people="varied", keys={"renderer": {"detail": "lod"}})
    note_origin(tmp_path, origin_of_runs([run_of(config, avatars)]))
    return tmp_path


def test_policy_says_of_what_its_data_were_made_after_it_was_written_and_read(policy: Path, avatars: Path) -> None:
    spec = load_spec(policy)
    origin = origin_of_policy(spec)
    assert origin is not None
    assert set(origin.scenes.values()) == {"embedded"}
    assert set(origin.avatars) == {"amara", "bruno"}
    assert avatars_of_policy(spec) == avatars
    assert spec.training["seed"] == 3


def test_evaluation_has_the_settings_of_the_data_and_the_policys_robot(policy: Path) -> None:
    settings = settings_of_policy(load_spec(policy))
    varied = load_run_config(None, people="varied")
    assert (settings.human_planner, settings.episode) == (varied.human_planner, varied.episode)
    assert settings.renderer.detail == "lod"
    assert (settings.robot, settings.renderer.sensor) == (SPEC.robot, SPEC.sensor)
    assert settings.expert == RunConfig().expert


def test_depth_is_what_it_was_in_the_data(avatars: Path) -> None:
    config = RunConfig(renderer=RendererConfig(depth="mean"))
    spec = with_origin(SPEC, origin_of_runs([run_of(config, avatars)]))
    assert settings_of_policy(spec).renderer.depth == "mean"


def test_humans_are_left_out_where_a_recipe_names_them(policy: Path) -> None:
    settings = settings_of_policy(load_spec(policy), humans=False)
    assert (settings.human_planner, settings.episode) == (RunConfig().human_planner, RunConfig().episode)
    assert settings.renderer.detail == "lod"


def test_policy_that_says_nothing_gets_the_defaults() -> None:
    assert origin_of_policy(SPEC) is None
    assert settings_of_policy(SPEC) == robot_of_policy(SPEC)
    assert avatars_of_policy(SPEC) is None


def test_data_without_humans_name_no_avatars(tmp_path: Path, avatars: Path) -> None:
    origin = origin_of_runs([run_of(RunConfig(), avatars, static=True)])
    assert not origin.avatars
    assert avatars_of_policy(with_origin(SPEC, origin)) is None


def test_avatars_that_have_moved_are_one_line(policy: Path, avatars: Path) -> None:
    avatars.rename(avatars.parent / "elsewhere")
    with pytest.raises(PolicyError, match=r"not at .*people of here any more; name them with --avatars\.$"):
        avatars_of_policy(load_spec(policy))


def test_avatars_that_have_changed_are_one_line(policy: Path, avatars: Path) -> None:
    shutil.copy(EMBEDDED_FOLDER / "clara.npz", avatars)
    with pytest.raises(PolicyError, match=r"any more \('clara' differs\); name them with --avatars\.$"):
        avatars_of_policy(load_spec(policy))


def test_embedded_avatars_of_the_data_are_taken_as_long_as_they_are_the_same() -> None:
    origin = origin_of_runs([run_of(RunConfig(), None)])
    assert avatars_of_policy(with_origin(SPEC, origin)) is None
    changed = dataclasses.replace(origin, avatars={**origin.avatars, "amara": "0"})
    with pytest.raises(PolicyError, match=r"not those in readygo any more \('amara' differs\)"):
        avatars_of_policy(with_origin(SPEC, changed))


def test_what_is_not_understood_is_one_line() -> None:
    with pytest.raises(PolicyError, match=r"\[training\.data\] .* Unknown key 'weather'"):
        origin_of_policy(dataclasses.replace(SPEC, training={"data": {"weather": "fine"}}))
    odd = with_origin(SPEC, DataOrigin(settings={"human_planner": {"moods": 3}}))
    with pytest.raises(PolicyError, match=r"settings of the policy's data .*human_planner\.moods"):
        settings_of_policy(odd)


@pytest.fixture(scope="module")
def casts() -> dict[str, RunSpec]:
    """Runs among the people to train with and among those to test with."""
    return {cast: run_of(RunConfig(), Path(f"embedded:{cast}")) for cast in ("train", "test")}


def test_cast_of_tests_is_tried_where_the_data_have_that_of_training(casts: dict[str, RunSpec]) -> None:
    policy = with_origin(SPEC, origin_of_runs([casts["train"]]))
    assert avatars_of_policy(policy) == Path("embedded:train")
    assert unseen_avatars(policy) == Path("embedded:test")
    check_unseen(policy, casts["test"], ["avatars"])
    check_unseen(policy, casts["train"], [])
    everybody = with_origin(SPEC, origin_of_runs([run_of(RunConfig(), None)]))
    assert unseen_avatars(everybody) is None


def test_what_a_policy_has_seen_is_refused_as_unseen(casts: dict[str, RunSpec], avatars: Path) -> None:
    policy = with_origin(SPEC, origin_of_runs([casts["train"]]))
    with pytest.raises(PolicyError, match="walked in the policy's data"):
        check_unseen(policy, casts["train"], ["avatars"])
    with pytest.raises(PolicyError, match="learned in this scene"):
        check_unseen(policy, casts["test"], ["scenes"])
    with pytest.raises(PolicyError, match="does not say what its data were made of"):
        check_unseen(SPEC, casts["test"], ["scenes"])
    mixed = with_origin(SPEC, origin_of_runs([run_of(RunConfig(), None, static=True), casts["test"]]))
    with pytest.raises(PolicyError, match="walked in the policy's data"):
        check_unseen(mixed, casts["test"], ["avatars"])
    few = with_origin(SPEC, origin_of_runs([casts["test"]]))
    with pytest.raises(PolicyError, match="needs 6 or more avatars"):
        check_unseen(few, casts["train"], ["avatars"])


def test_all_avatars_of_the_data_are_seen_also_those_of_one_name(avatars: Path, tmp_path: Path) -> None:
    others = tmp_path / "others"
    others.mkdir()
    shutil.copy(EMBEDDED_FOLDER / "clara.npz", others / "amara.npz")
    runs = [run_of(RunConfig(), folder) for folder in (avatars, others)]
    for order in (runs, runs[::-1]):
        spec = with_origin(SPEC, origin_of_runs(order))
        for run in runs:
            with pytest.raises(PolicyError, match="walked in the policy's data"):
                check_unseen(spec, run, ["avatars"])


def test_who_is_absent_in_the_data_comes_to_the_tests_of_the_policy() -> None:
    config = RunConfig(human_planner=HumanPlannerConfig(absent=0.4, absent_first=300, slope_max=0.7))
    tried = settings_of_policy(with_origin(SPEC, origin_of_runs([run_of(config, None)]))).human_planner
    assert (tried.absent, tried.absent_first, tried.slope_max) == (0.0, 0, 0.7)


def test_policy_of_several_mixes_is_tested_in_the_default_one_with_what_they_share() -> None:
    shared = {"human_planner": {"slope_max": 0.7}, "episode": {"time_limit_s": 40.0}, "renderer": {"detail": "lod"}}
    runs = [run_of(load_run_config(None, people=people, keys=shared), None) for people in ("crowd", "paper")]
    for order in (runs, runs[::-1]):
        settings = settings_of_policy(with_origin(SPEC, origin_of_runs(order)))
        paper = load_run_config(None, keys=shared)
        assert (settings.human_planner, settings.episode) == (paper.human_planner, paper.episode)
        assert settings.renderer.detail == "lod"
