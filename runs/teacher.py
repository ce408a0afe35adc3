"""Runs in which a state policy, the teacher, takes the expert's place: it labels, and drives the expert's episodes."""

import dataclasses
from pathlib import Path

from readygo.common.dataset.provenance import TeacherOrigin
from readygo.common.errors import PolicyError
from readygo.common.messages import RunSpec, TeacherRef
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


def with_teacher(spec: RunSpec, config: RunConfig, folder: Path) -> RunSpec:
    """A run in which a state policy takes the expert's place; it may have been trained in another scene.

    Args:
        spec: Spec of a run with the driver stage.
        config: Settings of the run.
        folder: Folder of the state policy, from `readygo rl`.

    Raises:
        PolicyError: If the policy cannot be used, or was trained for another robot.
    """
    if not is_state_policy(folder):
        raise PolicyError(f"--teacher: {folder} holds no state policy; train one: readygo rl SCENE --out {folder}.")
    trained = load_state_policy(folder).spec
    _check_robot(trained, config.robot)
    teacher = teacher_ref(folder)
    metadata = {
        **spec.metadata,
        "numeric_class": numeric_class(config, spec.policy, teacher),
        "teacher": dataclasses.asdict(TeacherOrigin(sha256=teacher.sha256)),
    }
    taught = dataclasses.replace(spec, teacher=teacher, metadata=metadata)
    return dataclasses.replace(taught, run=run_name(taught))


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
