"""Runs in which a teacher takes the expert's place: it labels, and drives the expert's episodes.

It is a state policy, or the expert that knows people by tracks of simulated detections.
"""

import dataclasses
from pathlib import Path

from readygo.common.config import section_differences
from readygo.common.dataset.provenance import TeacherOrigin
from readygo.common.errors import ConfigError, PolicyError
from readygo.common.messages import RunSpec, TeacherKind, TeacherRef
from readygo.common.robot import RobotConfig
from readygo.common.state_policy.robots import robot_difference
from readygo.common.state_policy.state_policy import (
    ACTOR_FILE,
    STATE_POLICY_FILE,
    StatePolicySpec,
    is_state_policy,
    load_state_policy,
)
from readygo.runs.config import RunConfig
from readygo.runs.identity import numeric_class, run_name
from readygo.runs.policy import file_ref


def with_teacher(spec: RunSpec, config: RunConfig, teacher: Path) -> RunSpec:
    """A run in which a teacher takes the expert's place.

    Args:
        spec: Spec of a run with the driver stage.
        config: Settings of the run.
        teacher: Folder of a state policy, from `readygo rl`, which may have been trained in another scene; or
            "expert-tracked", the expert that knows people by tracks of simulated detections.

    Raises:
        PolicyError: If the policy cannot be used, or was trained for another robot.
        ConfigError: If people cannot be tracked for the run's expert.
    """
    ref = tracked_ref(config) if str(teacher) == TeacherKind.EXPERT_TRACKED.value else _policy_ref(teacher, config)
    origin = TeacherOrigin(sha256=ref.sha256 if ref.files else "", kind=ref.kind.value)
    metadata = {
        **spec.metadata,
        "numeric_class": numeric_class(config, spec.policy, ref),
        "teacher": {name: value for name, _, value in section_differences(TeacherOrigin(), origin)},
    }
    taught = dataclasses.replace(spec, teacher=ref, metadata=metadata)
    return dataclasses.replace(taught, run=run_name(taught))


def _policy_ref(folder: Path, config: RunConfig) -> TeacherRef:
    """Reference to a state policy that drives a run's robot."""
    if not is_state_policy(folder):
        raise PolicyError(f"--teacher: {folder} holds no state policy; train one: readygo rl SCENE --out {folder}.")
    _check_robot(load_state_policy(folder).spec, config.robot)
    return teacher_ref(folder)


def tracked_ref(config: RunConfig) -> TeacherRef:
    """Reference to the expert among tracked people.

    Raises:
        ConfigError: If people cannot be tracked for the run's expert.
    """
    if config.expert.mode == "paper":
        raise ConfigError(
            f'The teacher {TeacherKind.EXPERT_TRACKED.value} tracks people, and the expert of mode "paper" takes '
            'bodies: set mode = "spacetime" under [expert].'
        )
    return TeacherRef(path="", files=(), kind=TeacherKind.EXPERT_TRACKED)


def teacher_ref(folder: Path) -> TeacherRef:
    """Reference to a state policy, with its hash."""
    files = tuple(file_ref(folder, name) for name in (STATE_POLICY_FILE, ACTOR_FILE))
    return TeacherRef(path=str(folder.resolve()), files=files)


def _check_robot(trained: StatePolicySpec, robot: RobotConfig) -> None:
    """Raise PolicyError unless a state policy drives a robot."""
    if robot.ranges.varies:
        raise PolicyError("--teacher: a state policy drives one robot; leave [ranges] out of robot.toml.")
    if difference := robot_difference(trained.robot, robot):
        raise PolicyError(f"--teacher: it was trained for another robot ({difference}); name its robot with --robot.")
