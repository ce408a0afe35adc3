import dataclasses
import os
from pathlib import Path

import pytest

from readygo.common.camera import SensorConfig
from readygo.common.dataset.provenance import Provenance
from readygo.common.errors import PolicyError, RunError
from readygo.common.messages import PolicyRef, RunSpec, decode, encode
from readygo.common.messages.stages import DRIVE_LINE
from readygo.runs.config import RunConfig, resolved_sections
from readygo.runs.identity import identity, numeric_class, run_name
from readygo.runs.policy import with_expert, with_offers, with_policy
from readygo.runs.world import World
from readygo.services.renderer import RendererConfig
from tests.common.messages.run_specs import SPEC
from tests.common.policy.artifacts import ROBOT, write_policy
from tests.runs.served import served

CONFIG = RunConfig(robot=ROBOT)


@pytest.fixture
def policy(tmp_path: Path) -> Path:
    return write_policy(tmp_path / "policy")


@pytest.fixture
def spec(policy: Path) -> RunSpec:
    plain = dataclasses.replace(SPEC, config=resolved_sections(CONFIG), scene_path=str(policy.parent / "scene"))
    return with_policy(plain, CONFIG, policy, 0.5)


def test_run_with_a_policy_has_the_drive_line_and_says_who_drives(spec: RunSpec) -> None:
    assert spec.stages == DRIVE_LINE
    assert spec.policy is not None
    assert decode(RunSpec, encode(spec)) == spec
    origin = Provenance.of_run(spec).policy
    assert origin is not None
    assert (origin.sha256, origin.mix) == (spec.policy.sha256, 0.5)
    assert "onnxruntime-" in spec.metadata["numeric_class"]
    assert "onnxruntime" not in numeric_class(CONFIG)


def test_policy_and_mix_are_part_of_a_runs_identity_and_the_place_is_not(spec: RunSpec, policy: Path) -> None:
    elsewhere = write_policy(policy.parent / "copy")
    assert run_name(with_policy(spec, CONFIG, elsewhere, 0.5)) == run_name(spec)
    assert run_name(with_policy(spec, CONFIG, policy, 0.25)) != run_name(spec)
    (policy / "policy.toml").write_text((policy / "policy.toml").read_text() + "\n[training.extra]\n")
    changed = with_policy(spec, CONFIG, policy, 0.5)
    assert run_name(changed) != run_name(spec)
    assert identity(changed)["policy"] != identity(spec)["policy"]


@pytest.mark.parametrize("mix", [-0.1, 1.5, float("nan")])
def test_mix_that_is_no_share_is_refused(policy: Path, mix: float) -> None:
    with pytest.raises(PolicyError, match=r"--mix must be 0\.\.1, got"):
        with_policy(SPEC, CONFIG, policy, mix)


@pytest.mark.parametrize(
    ("config", "text"),
    [
        (RunConfig(), r"another camera: .*height_px 8 \(the robot's: 144\)"),
        (
            RunConfig(robot=dataclasses.replace(ROBOT, v_max_mps=0.5)),
            r"another robot: v_max_mps 1\.0 \(the run's: 0\.5",
        ),
        (
            RunConfig(robot=ROBOT, renderer=RendererConfig(sensor=SensorConfig(exposure_ev=(-0.5, 0.5)))),
            r"another camera: sensor\.exposure_ev",
        ),
    ],
)
def test_policy_of_another_robot_is_refused_with_what_differs(policy: Path, config: RunConfig, text: str) -> None:
    with pytest.raises(PolicyError, match=text):
        with_policy(SPEC, config, policy, 0.5)


def test_worker_without_the_policy_fetches_it_from_the_run(
    spec: RunSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    bus = served(spec, tmp_path)
    assert spec.policy is not None
    away = dataclasses.replace(spec, policy=dataclasses.replace(spec.policy, path=str(tmp_path / "not-here")))
    assert away.policy is not None
    fetched = World(away, bus).policy(away.policy)
    assert fetched.spec.robot == ROBOT
    damaged = next((tmp_path / "cache").rglob("policy.toml"))
    damaged.write_text(damaged.read_text().replace("0.5", "0.6", 1))
    # A damaged file of the cache is fetched again.
    assert World(away, bus).policy(away.policy).spec == fetched.spec


def test_fetched_policies_are_kept_as_long_as_they_are_among_the_latest_used(
    spec: RunSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    bus = served(spec, tmp_path)
    assert spec.policy is not None
    away = dataclasses.replace(spec.policy, path=str(tmp_path / "not-here"))
    cache = tmp_path / "cache" / "readygo" / "policies"
    for name, used_s in ((away.sha256, 0), *((f"{age:02d}", 1000 - age) for age in range(10))):
        (cache / name).mkdir(parents=True)
        os.utime(cache / name, (used_s, used_s))
    World(spec, bus).policy(away)
    assert {path.name for path in cache.iterdir()} == {away.sha256, *(f"{age:02d}" for age in range(7))}


def test_policy_that_was_trained_on_since_the_run_began_is_refused(spec: RunSpec, policy: Path) -> None:
    (policy / "policy.toml").write_text((policy / "policy.toml").read_text() + "\n[training.extra]\n")
    with pytest.raises(RunError, match=r"Policy .*policy has changed since the run began; record into a new folder"):
        World(spec).policy(spec.policy)


def test_run_that_takes_policies_has_none_yet(spec: RunSpec) -> None:
    live = with_offers(dataclasses.replace(spec, policy=None), CONFIG, 0.25)
    assert (live.stages, live.policy) == (DRIVE_LINE, PolicyRef(path="", files=(), mix=0.25))
    assert "onnxruntime-" in live.metadata["numeric_class"]
    assert len({live.run, spec.run, with_offers(spec, CONFIG, 0.5).run}) == 3
    with pytest.raises(PolicyError, match=r"mix must be 0\.\.1"):
        with_offers(spec, CONFIG, 1.5)


def test_run_of_the_expert_alone_may_have_the_drive_line() -> None:
    driven = with_expert(SPEC)
    assert (driven.stages, driven.policy) == (DRIVE_LINE, None)
    assert driven.run != run_name(SPEC)
