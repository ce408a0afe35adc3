"""Runs with a driver stage: a policy drives, or policies offered during the run, or the expert."""

import dataclasses
import hashlib
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from readygo.common.config import section_differences
from readygo.common.dataset.provenance import PolicyOrigin
from readygo.common.errors import PolicyError
from readygo.common.files import read_regular
from readygo.common.messages import FileRef, PolicyFile, PolicyRef, RunSpec
from readygo.common.messages.stages import DRIVE_LINE
from readygo.common.policy import check_policy_camera, load_policy
from readygo.common.policy.artifact import POLICY_FILES
from readygo.common.policy.robots import RANGED, known_as
from readygo.runs.config import RunConfig
from readygo.runs.identity import numeric_class, run_name


def with_policy(spec: RunSpec, config: RunConfig, folder: Path, mix: float) -> RunSpec:
    """A run in which a policy drives a share of the episodes, with expert labels at every sample.

    Args:
        spec: Spec of the run, without a policy.
        config: Settings of the run.
        folder: Folder of the policy.
        mix: Policy fraction: share of the episodes that the policy drives, 0..1.

    Raises:
        PolicyError: If the policy cannot be used, was trained for another robot or camera, or `mix` is not in 0..1.
    """
    check_policy(folder, config)
    try:
        files = policy_refs(folder)
        policy = PolicyRef(path=str(folder.resolve()), files=files, mix=mix)
    except ValueError as error:
        raise PolicyError(f"--{error}") from error
    origin = PolicyOrigin(sha256=policy.sha256, mix=mix)
    return _with_policy_ref(
        spec, policy, {"numeric_class": numeric_class(config, policy), "policy": dataclasses.asdict(origin)}
    )


def with_offers(spec: RunSpec, config: RunConfig, mix: float) -> RunSpec:
    """A learning run: the newest of the offered policies drives a share of the episodes.

    Until a policy is offered, the expert drives all episodes.

    Args:
        spec: Spec of the run, without a policy.
        config: Settings of the run.
        mix: Policy fraction: share of the episodes that policies drive, 0..1.

    Raises:
        PolicyError: If `mix` is not in 0..1, or policies cannot run on this machine.
    """
    try:
        policy = PolicyRef(path="", files=(), mix=mix)
    except ValueError as error:
        raise PolicyError(str(error)) from error
    return _with_policy_ref(spec, policy, {"numeric_class": numeric_class(config, policy)})


def with_expert(spec: RunSpec) -> RunSpec:
    """A run in which the expert drives with the noise injection of `DriverConfig`, with expert labels."""
    return _with_policy_ref(spec, None, {})


def _with_policy_ref(spec: RunSpec, policy: PolicyRef | None, metadata: Mapping[str, Any]) -> RunSpec:
    driven = dataclasses.replace(spec, stages=DRIVE_LINE, policy=policy, metadata={**spec.metadata, **metadata})
    return dataclasses.replace(driven, run=run_name(driven))


def check_offer(files: Sequence[PolicyFile], config: RunConfig) -> None:
    """Raise PolicyError unless the files that a trainer offers are a policy that can drive in a run."""
    with tempfile.TemporaryDirectory() as name:
        for file in files:
            (Path(name) / file.name).write_bytes(file.data)
        try:
            check_policy(Path(name), config)
        except PolicyError as error:
            raise PolicyError(str(error).replace(name, "the offered policy")) from error


def check_policy(folder: Path, config: RunConfig) -> None:
    """Check that a policy can drive in a run.

    Raises:
        PolicyError: If it cannot be used, or was trained with a different camera, sensor or robot.
    """
    trained = load_policy(folder).spec
    check_policy_camera(trained, config.robot, config.renderer.sensor)
    known = known_as(trained.robot, config.robot, RANGED)
    for name, ours, theirs in section_differences(known, config.robot):
        raise PolicyError(f"The policy was trained for another robot: {name} {ours} (the run's: {theirs}).")


def policy_sha256(folder: Path) -> str:
    """SHA-256 over the files of a policy, by which runs name it."""
    return PolicyRef(path="", files=policy_refs(folder), mix=0.0).sha256


def policy_refs(folder: Path) -> tuple[FileRef, ...]:
    """References to all files of a policy, for workers to fetch."""
    return tuple(file_ref(folder, name) for name in POLICY_FILES)


def file_ref(folder: Path, name: str) -> FileRef:
    """Reference to a file, for workers to fetch."""
    data = read_regular(folder / name)
    return FileRef(path=name, sha256=hashlib.sha256(data).hexdigest(), size=len(data))
