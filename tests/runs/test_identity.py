import dataclasses
import hashlib
import importlib.metadata
import subprocess
from pathlib import Path

import pytest

from readygo.common.dataset.provenance import SceneOrigin
from readygo.common.errors import RunError
from readygo.common.extras import ROOT
from readygo.common.messages import FileRef, OnRejection, PolicyRef, RunSpec, Split, TeacherKind, TeacherRef
from readygo.common.messages.stages import DRIVE_LINE, EXPERT_LINE
from readygo.runs.config import RunConfig, resolved_sections
from readygo.runs.identity import check_same_make, files_of, identity, numeric_class, run_metadata, run_name
from readygo.services.coordinator import CoordinatorConfig
from readygo.services.recorder import RecorderConfig
from tests.common.messages.run_specs import SPEC


def _with(config: RunConfig) -> RunSpec:
    return dataclasses.replace(SPEC, config=resolved_sections(config))


def test_name_of_a_run_that_began_before_stages_were_data_stays() -> None:
    assert run_name(SPEC) == "run-0a4ef7ae8c23"
    assert "stages" not in identity(SPEC)


def test_recorders_and_leases_are_no_part_of_a_runs_identity() -> None:
    other = RunConfig(
        recorder=RecorderConfig(fsync=False), coordinator=CoordinatorConfig(lease_s=1.0, recorders=("a", "b"))
    )
    assert identity(_with(other)) == identity(_with(RunConfig()))


def test_seed_settings_and_stages_are_part_of_a_runs_identity() -> None:
    config = RunConfig()
    stages = (*EXPERT_LINE[:2], dataclasses.replace(EXPERT_LINE[2], on_rejection=OnRejection.KEEP), EXPERT_LINE[3])
    others = [
        dataclasses.replace(SPEC, seed=6),
        dataclasses.replace(SPEC, stages=stages),
        _with(dataclasses.replace(config, renderer=dataclasses.replace(config.renderer, labels=False))),
        _with(config),
    ]
    assert len({run_name(spec) for spec in [SPEC, *others]}) == 5


def test_what_is_recorded_beside_the_samples_is_not() -> None:
    assert run_name(dataclasses.replace(SPEC, scene_path="elsewhere", metadata={"commit": "1"})) == run_name(SPEC)


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="readygo runs outside of a checkout")
def test_metadata_name_the_commit_of_the_checkout() -> None:
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    origin = SceneOrigin(name="lobby", hash="0" * 64, license="")
    metadata = run_metadata(RunConfig(), scene=origin, avatars={}, scenarios=None)
    assert metadata["commit"] == head.stdout.strip() != ""


def test_machine_that_would_make_other_samples_is_refused() -> None:
    config = RunConfig()

    def made(**metadata: str) -> RunSpec:
        return dataclasses.replace(_with(config), metadata={**SPEC.metadata, **metadata})

    ours = {"readygo_version": importlib.metadata.version("readygo"), "numeric_class": numeric_class(config)}
    check_same_make(made(**ours), config)
    with pytest.raises(RunError, match=r"The run is of readygo 0\.0\.9, this is .*: use the same version"):
        check_same_make(made(**{**ours, "readygo_version": "0.0.9"}), config)
    with pytest.raises(RunError, match="samples are of the numeric class 'abacus', this machine's would be of"):
        check_same_make(made(**{**ours, "numeric_class": "abacus"}), config)


def test_each_thing_that_samples_depend_on_is_part_of_a_runs_identity() -> None:
    policy = PolicyRef(path="p", files=(FileRef(path="head", sha256="1" * 64, size=3),), mix=0.25)
    changes: list[dict[str, object]] = [
        {"scene_hash": "1" * 64}, {"avatar_hashes": {"ann": "1" * 64}}, {"seed": 6}, {"split": Split.VAL},
        {"static": True},
        {"scenarios": "<a/>"}, {"scenarios": "<b/>"}, {"config": {"robot": {"radius_m": 0.3}}}, {"policy": policy},
        {"policy": dataclasses.replace(policy, mix=0.5)}, {"stages": DRIVE_LINE},
        {"policy": dataclasses.replace(policy, files=(FileRef(path="head", sha256="2" * 64, size=3),))},
        {"teacher": TeacherRef(path="t", files=policy.files)}, {"teacher": TeacherRef(path="t", files=())},
        {"teacher": TeacherRef(path="", files=(), kind=TeacherKind.EXPERT_TRACKED)},
    ]  # fmt: skip
    specs = [SPEC, *(dataclasses.replace(SPEC, **change) for change in changes)]  # type: ignore[arg-type]
    assert len({run_name(spec) for spec in specs}) == len(specs)
    same = [
        {"run": "other"}, {"scene_files": (FileRef(path="s", sha256="1" * 64, size=3),)}, {"avatars_path": "elsewhere"},
        {"config": {"recorder": {"fsync": False}}},
    ]  # fmt: skip
    assert {run_name(dataclasses.replace(SPEC, **change)) for change in same} == {run_name(SPEC)}  # type: ignore[arg-type]


def test_files_of_a_run_are_where_it_began(tmp_path: Path) -> None:
    hashes = {name: hashlib.sha256(name.encode()).hexdigest() for name in ("scene.ply", "ann.npz", "head")}
    files = {name: FileRef(path=name, sha256=sha256, size=3) for name, sha256 in hashes.items()}
    spec = dataclasses.replace(SPEC, scene_path="scenes/hall", scene_files=(files["scene.ply"],))
    assert files_of(spec) == {hashes["scene.ply"]: Path("scenes/hall/scene.ply")}
    archive = tmp_path / "people.zip"
    archive.write_bytes(b"")
    with_people = dataclasses.replace(spec, avatars_path=str(tmp_path), avatar_files=(files["ann.npz"],))
    assert files_of(with_people)[hashes["ann.npz"]] == tmp_path / "ann.npz"
    one = dataclasses.replace(with_people, avatars_path=str(archive))
    assert files_of(one)[hashes["ann.npz"]] == archive
    driven = dataclasses.replace(one, policy=PolicyRef(path="policy", files=(files["head"],), mix=0.1))
    assert files_of(driven) == {**files_of(one), hashes["head"]: Path("policy/head")}
    taught = dataclasses.replace(one, teacher=TeacherRef(path="teacher", files=(files["head"],)))
    assert files_of(taught) == {**files_of(one), hashes["head"]: Path("teacher/head")}
