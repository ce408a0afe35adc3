import dataclasses
from pathlib import Path

import pytest

from readygo.common.camera import CameraConfig
from readygo.common.dataset.provenance import Provenance, SceneOrigin, TeacherOrigin
from readygo.common.errors import ConfigError, PolicyError, RunError
from readygo.common.messages import RunSpec, TeacherKind, TeacherRef, decode, encode
from readygo.common.messages.stages import DRIVE_LINE
from readygo.common.robot import RobotConfig
from readygo.common.robot.ranges import RobotRanges
from readygo.runs.config import RunConfig, resolved_sections
from readygo.runs.identity import check_same_make, numeric_class
from readygo.runs.policy import with_expert, with_policy
from readygo.runs.teacher import tracked_ref, with_teacher
from readygo.runs.world import World
from readygo.services.planner import ExpertConfig
from tests.common.messages.run_specs import SPEC
from tests.common.policy.artifacts import ROBOT, write_policy
from tests.common.state_policy.state_policies import write_state_policy
from tests.runs.served import served

CONFIG = RunConfig()
PLAIN = dataclasses.replace(with_expert(SPEC), config=resolved_sections(CONFIG))


@pytest.fixture
def teacher(tmp_path: Path) -> Path:
    return write_state_policy(tmp_path / "teacher")


def test_run_with_a_teacher_says_who_labels(teacher: Path) -> None:
    spec = with_teacher(PLAIN, CONFIG, teacher)
    assert (spec.stages, spec.policy) == (DRIVE_LINE, None)
    assert spec.teacher is not None
    assert decode(RunSpec, encode(spec)) == spec
    origin = Provenance.of_run(spec).teacher
    assert origin is not None
    assert origin.sha256 == spec.teacher.sha256
    assert Provenance.of_run(PLAIN).teacher is None
    assert " blas" in spec.metadata["numeric_class"]
    assert "blas" not in numeric_class(CONFIG)
    check_same_make(spec, CONFIG)


def test_teacher_is_part_of_a_runs_name_and_its_place_is_not(teacher: Path, tmp_path: Path) -> None:
    same = write_state_policy(tmp_path / "copy")
    other = write_state_policy(tmp_path / "other", seed=1)
    names = [with_teacher(PLAIN, CONFIG, folder).run for folder in (teacher, same, other)]
    assert names[0] == names[1]
    assert len({PLAIN.run, *names}) == 3


def test_teacher_and_policy_go_together(tmp_path: Path) -> None:
    config = RunConfig(robot=ROBOT)
    teacher = write_state_policy(tmp_path / "teacher", robot=ROBOT)
    driven = with_policy(PLAIN, config, write_policy(tmp_path / "policy"), 0.5)
    spec = with_teacher(driven, config, teacher)
    assert spec.policy == driven.policy
    assert {"onnxruntime", "blas"} <= {part.split("-")[0] for part in spec.metadata["numeric_class"].split()}


def test_teacher_drives_a_robot_whose_camera_has_other_pixels_of_the_same_view(teacher: Path) -> None:
    small = RobotConfig(camera=CameraConfig(height_px=72, width_px=128, latency_s=0.1))
    assert with_teacher(PLAIN, RunConfig(robot=small), teacher).teacher is not None


@pytest.mark.parametrize(
    ("robot", "words"),
    [
        (RobotConfig(v_max_mps=0.5), r"another robot \(v_max_mps is 1\.0, here 0\.5\); name its robot with --robot"),
        (RobotConfig(camera=CameraConfig(horizontal_fov_deg=60.0)), "another robot .its cameras show something else"),
        (RobotConfig(cameras={"left": CameraConfig(mount_yaw_deg=90.0)}), "its cameras show something else"),
        (RobotConfig(ranges=RobotRanges(radius_m=(0.2, 0.3))), "drives one robot; leave .ranges. out"),
    ],
)
def test_teacher_of_another_robot_is_refused(teacher: Path, robot: RobotConfig, words: str) -> None:
    with pytest.raises(PolicyError, match=f"^--teacher: .*{words}"):
        with_teacher(PLAIN, RunConfig(robot=robot), teacher)


def test_teacher_drives_in_another_scene_than_its_own(teacher: Path) -> None:
    scene = dataclasses.asdict(SceneOrigin(name="lobby", hash="1" * 64))
    elsewhere = dataclasses.replace(PLAIN, scene_hash="1" * 64, metadata={"scene": scene})
    taught = with_teacher(elsewhere, CONFIG, teacher)
    assert taught.scene_hash == "1" * 64
    assert taught.teacher == with_teacher(PLAIN, CONFIG, teacher).teacher


def test_folder_without_a_state_policy_is_refused(tmp_path: Path) -> None:
    for folder in (tmp_path / "nowhere", write_policy(tmp_path / "policy")):
        with pytest.raises(PolicyError, match=f"{folder} holds no state policy; train one: readygo rl SCENE --out"):
            with_teacher(PLAIN, CONFIG, folder)


def test_expert_among_tracked_people_is_a_teacher_by_its_name() -> None:
    spec = with_teacher(PLAIN, CONFIG, Path("expert-tracked"))
    assert spec.teacher == tracked_ref(CONFIG) == TeacherRef(path="", files=(), kind=TeacherKind.EXPERT_TRACKED)
    assert decode(RunSpec, encode(spec)) == spec
    assert spec.metadata["teacher"] == {"kind": "expert-tracked"}
    assert Provenance.of_run(spec).teacher == TeacherOrigin(kind="expert-tracked")
    assert spec.run != PLAIN.run
    assert " blas" in spec.metadata["numeric_class"]
    assert World(spec).teacher is None
    check_same_make(spec, CONFIG)


def test_people_are_not_tracked_for_an_expert_that_takes_bodies() -> None:
    config = RunConfig(expert=ExpertConfig(mode="paper"))
    with pytest.raises(ConfigError, match=r'^The teacher expert-tracked tracks people.*set mode = "spacetime" under'):
        with_teacher(PLAIN, config, Path("expert-tracked"))


def test_worker_without_the_teacher_fetches_it_from_the_run(
    teacher: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    spec = with_teacher(PLAIN, CONFIG, teacher)
    bus = served(spec, tmp_path)
    assert spec.teacher is not None
    away = dataclasses.replace(spec, teacher=dataclasses.replace(spec.teacher, path=str(tmp_path / "not-here")))
    fetched = World(away, bus).teacher
    assert fetched is not None
    assert list(fetched.spec.scenes.values()) == ["hall"]
    assert (tmp_path / "cache" / "readygo" / "teachers" / spec.teacher.sha256 / "actor.npz").is_file()
    assert World(PLAIN, bus).teacher is None


def test_teacher_that_was_trained_on_since_the_run_began_is_refused(teacher: Path) -> None:
    spec = with_teacher(PLAIN, CONFIG, teacher)
    write_state_policy(teacher, seed=1)
    with pytest.raises(RunError, match=r"Teacher .*teacher has changed since the run began; record into a new folder"):
        _ = World(spec).teacher
