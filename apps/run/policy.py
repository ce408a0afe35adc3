"""Runs in which a policy drives."""

import dataclasses
import hashlib
from pathlib import Path

from readygo.apps.run.config import RunConfig
from readygo.apps.run.identity import numeric_class, policy_hash, run_name
from readygo.common.config import section_differences
from readygo.common.dataset.provenance import PolicyOrigin
from readygo.common.errors import PolicyError
from readygo.common.messages import FileRef, PolicyRef, RunSpec
from readygo.common.messages.stages import DRIVE_LINE
from readygo.common.policy import PolicySpec, check_policy_camera, load_policy
from readygo.common.policy.artifact import ENCODER_FILE, HEAD_FILE, SPEC_FILE


def with_policy(spec: RunSpec, config: RunConfig, folder: Path, mix: float) -> RunSpec:
    """A run in which a policy drives a share of the episodes, and the expert says at every state what it would do.

    Args:
        spec: The run with the expert alone.
        config: Its settings.
        folder: The policy's folder.
        mix: Share of the episodes that the policy drives, 0..1.

    Raises:
        PolicyError: If the policy cannot be used, or is one for another robot or camera, or `mix` is no share.
    """
    check_policy_robot(load_policy(folder).spec, config)
    try:
        files = tuple(file_ref(folder, name) for name in (ENCODER_FILE, HEAD_FILE, SPEC_FILE))
        policy = PolicyRef(path=str(folder.resolve()), files=files, mix=mix)
    except ValueError as error:
        raise PolicyError(f"--{error}") from error
    origin = PolicyOrigin(sha256=policy_hash(policy), mix=mix)
    metadata = {
        **spec.metadata,
        "numeric_class": numeric_class(config, policy),
        "policy": dataclasses.asdict(origin),
    }
    driven = dataclasses.replace(spec, stages=DRIVE_LINE, policy=policy, metadata=metadata)
    return dataclasses.replace(driven, run=run_name(driven))


def check_policy_robot(trained: PolicySpec, config: RunConfig) -> None:
    """Raise PolicyError unless a run has the camera, the sensor and the robot that a policy was trained with."""
    check_policy_camera(trained, config.robot, config.renderer.sensor)
    for name, ours, theirs in section_differences(trained.robot, config.robot):
        raise PolicyError(f"The policy was trained for another robot: {name} {ours} (the run's: {theirs}).")


def file_ref(folder: Path, name: str) -> FileRef:
    """A file as workers fetch it."""
    data = (folder / name).read_bytes()
    return FileRef(path=name, sha256=hashlib.sha256(data).hexdigest(), size=len(data))
