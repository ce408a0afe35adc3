import dataclasses
import json
from pathlib import Path

import pytest

from readygo.apps.learn.config import LearnConfig
from readygo.apps.learn.plan import (
    Budget,
    LearnPlan,
    free_name,
    learn_configs,
    learn_settings,
    lock_folder,
    make_plan,
    read_state,
    write_state,
)
from readygo.common.avatars.cast import load_cast
from readygo.common.avatars.file import avatar_hash
from readygo.common.avatars.variants import write_variants
from readygo.common.errors import ConfigError, PolicyError, ReadygoError, RunError, SceneError
from readygo.common.messages.stages import DRIVE_LINE
from readygo.common.perception.artifact import (
    WEIGHTS_FILE,
    PerceptionSpec,
    load_perception_spec,
    save_perception_spec,
)
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.runs.config import RunConfig
from readygo.runs.scene_argument import open_scene
from readygo.runs.teacher import teacher_ref, tracked_ref
from readygo.services.trainer.config import PERCEPTION_WIDTHS
from tests.common.state_policy.state_policies import write_state_policy


def plan_of(
    out: Path,
    config: RunConfig | None = None,
    scenes: tuple[str, ...] = ("embedded",),
    seed: int = 0,
    teacher: Path | None = None,
) -> LearnPlan:
    settings, budget = config or learn_settings(None, None), Budget(minutes=1.0)
    return make_plan(scenes, out, settings, LearnConfig(), budget, avatars=None, seed=seed, teacher=teacher)


def test_run_waits_for_policies_and_says_what_the_expert_would_do(tmp_path: Path) -> None:
    plan = plan_of(tmp_path / "run")
    spec = plan.places[0].spec
    assert spec.stages == DRIVE_LINE
    assert spec.policy is not None
    assert (spec.policy.files, spec.policy.mix) == ((), 0.8)
    assert plan.places[0].folder.path == tmp_path / "run" / "data" / "embedded"
    assert not (tmp_path / "run").exists()


def test_what_nobody_names_is_as_learning_needs_it(tmp_path: Path) -> None:
    config = learn_settings(None, None)
    assert (config.robot.camera.height_px, config.robot.camera.width_px) == (72, 128)
    assert config.renderer.detail == "lod"
    assert config.human_planner.absent > 0
    assert config.driver.disturbed > 0
    (tmp_path / "run.toml").write_text('[renderer]\ndetail = "exact"\n[robot]\nv_max_mps = 0.5\n')
    named = learn_settings(tmp_path / "run.toml", None)
    assert (named.renderer.detail, named.robot.v_max_mps, named.robot.camera.width_px) == ("exact", 0.5, 128)
    (tmp_path / "robot.toml").write_text("[camera]\nwidth_px = 256\nheight_px = 144\n")
    assert learn_settings(None, tmp_path / "robot.toml").robot.camera == CameraConfig(width_px=256, height_px=144)


def test_nobody_walks_in_the_first_episodes_which_scenes_share_unless_the_file_says_otherwise(tmp_path: Path) -> None:
    first = [
        learn_configs(None, None, "", "", scene_count=count)[0].human_planner.absent_first for count in (1, 2, 3, 7)
    ]
    assert first == [600, 300, 200, 86]
    (tmp_path / "run.toml").write_text("[human_planner]\nabsent_first = 5\n")
    assert learn_settings(tmp_path / "run.toml", None, scene_count=2).human_planner.absent_first == 5


def test_images_of_goals_are_recorded_where_the_policy_sees_them(tmp_path: Path) -> None:
    assert not learn_configs(None, None, "", "")[0].renderer.goal_image
    runs, learn = learn_configs(None, None, "", "", "both")
    assert (runs.renderer.goal_image, learn.goal) == (True, "both")
    (tmp_path / "run.toml").write_text('[learn]\ngoal = "image"\n')
    runs, learn = learn_configs(tmp_path / "run.toml", None, "", "")
    assert (runs.renderer.goal_image, learn.goal) == (True, "image")
    with pytest.raises(ConfigError, match='goal "image" goes with the rgb of one camera'):
        learn_configs(tmp_path / "run.toml", None, "rgb,depth", "")


def test_keys_win_over_the_options_and_these_over_the_file(tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text('[learn]\ngoal = "image"\nreuse = 2\n')
    options = (tmp_path / "run.toml", None, "rgb,depth", "")
    with pytest.raises(ConfigError, match='goal "image" goes with the rgb of one camera'):
        learn_configs(*options)
    _, learn = learn_configs(*options, keys={"learn": {"goal": "point"}})
    assert learn == LearnConfig(goal="point", images=("rgb", "depth"), reuse=2.0)
    _, learn = learn_configs(*options, "both", keys={"learn": {"images": ["rgb"]}})
    assert learn == LearnConfig(goal="both", images=("rgb",), reuse=2.0)


def test_a_fifth_of_the_samples_has_an_image(tmp_path: Path) -> None:
    assert plan_of(tmp_path / "run").image_count(83_126) == 16_625


def test_two_scenes_of_one_name_have_a_folder_each() -> None:
    assert [free_name("flat", []), free_name("flat", ["flat"])] == ["flat", "flat-2"]
    assert free_name("flat", ["flat", "flat-2"]) == "flat-3"


def test_scene_that_is_named_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="is named twice"):
        plan_of(tmp_path / "run", scenes=("embedded", str(open_scene("embedded").path)))


def test_run_goes_on_only_as_what_it_is(tmp_path: Path) -> None:
    plan = plan_of(tmp_path / "run")
    with lock_folder(plan.out):
        write_state(plan, spent_s=12.0)
        for place in plan.places:
            with place.folder.lock():
                place.folder.save(place.spec, 10)
                place.folder.ledger.touch()
        with pytest.raises(RunError, match="Another process is learning in"), lock_folder(plan.out):
            pass
    assert read_state(plan_of(tmp_path / "run"))["spent_s"] == 12.0
    with pytest.raises(RunError, match="holds data of another run: seed differ"):
        plan_of(tmp_path / "run", seed=1)
    other = learn_settings(None, None)
    other = dataclasses.replace(other, human_planner=dataclasses.replace(other.human_planner, effort="quick"))
    with pytest.raises(RunError, match=r"another run: config \(human_planner\) differ"):
        plan_of(tmp_path / "run", other)
    state = json.loads(plan.state_file.read_text())
    plan.state_file.write_text(json.dumps({**state, "runs": {"lobby": "run-1"}}))
    with pytest.raises(RunError, match="learns in lobby; choose another --out for other scenes"):
        plan_of(tmp_path / "run")


def test_teacher_is_refused_where_the_expert_is_to_label(tmp_path: Path) -> None:
    for name in ("expert", "expert-tracked"):
        settings, learn = learn_configs(None, None, "", "", keys={"learn": {"teacher": name}})
        with pytest.raises(ConfigError, match=rf'^--teacher is .*rl, and learn\.teacher is "{name}": leave one'):
            make_plan(
                ("embedded",), tmp_path, settings, learn, Budget(minutes=1.0), avatars=None, seed=0,
                teacher=tmp_path / "rl",
            )  # fmt: skip


def test_expert_among_tracked_people_teaches_where_the_settings_say_so(tmp_path: Path) -> None:
    settings, learn = learn_configs(None, None, "", "", keys={"learn": {"teacher": "expert-tracked"}})
    plan = make_plan(("embedded",), tmp_path, settings, learn, Budget(minutes=1.0), avatars=None, seed=0)
    assert plan.places[0].spec.teacher == tracked_ref(settings)
    assert plan.places == plan_of(tmp_path, settings, teacher=Path("expert-tracked")).places
    assert plan_of(tmp_path, settings).places[0].spec.teacher is None


def test_teacher_is_part_of_the_run(tmp_path: Path) -> None:
    first, other = (write_state_policy(tmp_path / f"{k}", seed=k) for k in range(2))
    plan = plan_of(tmp_path / "run", teacher=first)
    (place,) = plan.places
    assert place.spec.teacher is not None
    assert place.spec.policy is not None
    assert place.spec.metadata["teacher"] == {"sha256": place.spec.teacher.sha256}
    with place.folder.lock():
        place.folder.save(place.spec, 10)
        place.folder.ledger.touch()
    with lock_folder(plan.out):
        write_state(plan, spent_s=12.0)
    assert plan_of(tmp_path / "run", teacher=first).places == plan.places
    for teacher in (other, None):
        with pytest.raises(RunError, match="holds data of another run: teacher differ"):
            plan_of(tmp_path / "run", teacher=teacher)


def test_people_of_the_data_may_be_others_than_those_of_the_measurements(tmp_path: Path) -> None:
    people = tmp_path / "people"
    write_variants(Path("embedded:train"), people, 1, 0)
    settings, budget = learn_settings(None, None), Budget(minutes=1.0)
    plan = make_plan(
        ("embedded",), tmp_path / "run", settings, LearnConfig(), budget,
        avatars=Path("embedded:test"), seed=0, people=people,
    )  # fmt: skip
    assert plan.avatars == plan.tested == Path("embedded:test")
    assert plan.places[0].spec.avatars_path == str(people)


def test_some_avatars_are_kept_for_the_test(tmp_path: Path) -> None:
    people = tmp_path / "people"
    write_variants(Path("embedded:train"), people, 1, 0)
    settings, budget = learn_settings(None, None), Budget(minutes=1.0)
    learned, tested = Path("embedded:train"), Path("embedded:test")
    for number, (given, walking) in enumerate([(people, people), (None, learned)]):
        out = tmp_path / str(number)
        plan = make_plan(("embedded",), out, settings, LearnConfig(), budget, avatars=None, seed=0, people=given)
        assert (plan.avatars, plan.tested) == (learned, tested)
        hashes = {name: avatar_hash(avatar) for name, avatar in load_cast(walking).items()}
        assert plan.places[0].spec.avatar_hashes == hashes


def test_one_teacher_labels_in_several_scenes(tmp_path: Path) -> None:
    teacher = write_state_policy(tmp_path / "teacher")
    plan = plan_of(tmp_path / "run", scenes=("embedded", "embedded:1"), teacher=teacher)
    assert [place.spec.teacher for place in plan.places] == [teacher_ref(teacher)] * 2


def test_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "precious.txt").write_text("")
    with pytest.raises(RunError, match="holds files of something else"):
        plan_of(tmp_path)


def test_broken_state_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "learn.json").write_text("{}")
    with pytest.raises(RunError, match=r"learn\.json cannot be read: "):
        plan_of(tmp_path)


def test_scene_without_room_for_humans_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    config = learn_settings(None, None)
    quick = dataclasses.replace(config.human_planner, effort="quick")
    giants = dataclasses.replace(config.episode, human_radius_m=5.0)
    with pytest.raises(SceneError, match=r"^Scene embedded has no room for humans: of 40 scenarios none can"):
        plan_of(tmp_path / "run", dataclasses.replace(config, human_planner=quick, episode=giants))
    assert not (tmp_path / "run").exists()


def test_scene_must_be_named(tmp_path: Path) -> None:
    with pytest.raises(ReadygoError, match="Name a scene"):
        plan_of(tmp_path / "run", scenes=())


@pytest.mark.parametrize(("latency_s", "hz"), [(0.0, 4.0), (0.25, 4.0), (0.1, 20.0)])
def test_pictures_are_as_few_as_the_cameras_latency_allows(tmp_path: Path, latency_s: float, hz: float) -> None:
    (tmp_path / "robot.toml").write_text(f"[camera]\nwidth_px = 128\nheight_px = 72\nlatency_s = {latency_s}\n")
    assert learn_settings(None, tmp_path / "robot.toml").driver.camera_hz == hz


def perceiving(folder: Path, *, spacing_s: float = 0.2, camera: CameraConfig | None = None) -> Path:
    """Untrained perception, as far as a plan reads it."""
    torch = pytest.importorskip("torch", reason="torch (extra train) is not installed")
    from safetensors.torch import save

    from readygo.services.trainer.perception.network import PerceptionNet

    torch.manual_seed(0)
    folder.mkdir()
    robot = RobotConfig(camera=camera or CameraConfig(height_px=72, width_px=96), v_max_mps=0.7)
    save_perception_spec(PerceptionSpec(robot=robot, spacing_s=spacing_s), folder)
    (folder / WEIGHTS_FILE).write_bytes(save(PerceptionNet(robot.camera, PERCEPTION_WIDTHS).state_dict()))
    return folder


def test_robot_and_image_rate_are_those_of_perception(tmp_path: Path) -> None:
    folder = perceiving(tmp_path / "perception")
    config, _ = learn_configs(None, None, "", "", perception=folder)
    assert config.robot == load_perception_spec(folder).robot
    assert config.driver.camera_hz == 5.0
    config, _ = learn_configs(None, None, "", "", perception=perceiving(tmp_path / "slower", spacing_s=0.5))
    assert config.driver.camera_hz == 4.0


def test_perception_that_does_not_see_the_policys_images_is_refused(tmp_path: Path) -> None:
    folder, robot = perceiving(tmp_path / "perception"), tmp_path / "robot.toml"
    for inputs, goal in (("rgb,depth", None), ("", "image")):
        with pytest.raises(ConfigError, match='rgb of one camera and goal "point"'):
            learn_configs(None, None, inputs, "", goal, perception=folder)  # type: ignore[arg-type]
    robot.write_text("[camera]\nheight_px = 72\nwidth_px = 128\n")
    with pytest.raises(PolicyError, match="perceives with another camera"):
        learn_configs(None, robot, "", "", perception=folder)


def test_perception_that_is_not_whole_is_refused(tmp_path: Path) -> None:
    weights = perceiving(tmp_path / "perception") / WEIGHTS_FILE
    weights.write_bytes(weights.read_bytes()[:1000])
    with pytest.raises(PolicyError, match=r"weights\.safetensors cannot be read: .*; train perception again"):
        learn_configs(None, None, "", "", perception=weights.parent)
    weights.unlink()
    with pytest.raises(PolicyError, match=r"weights\.safetensors cannot be read: .*; train perception again"):
        learn_configs(None, None, "", "", perception=weights.parent)


def test_run_goes_on_with_the_same_perception_only(tmp_path: Path) -> None:
    first, other = perceiving(tmp_path / "first"), perceiving(tmp_path / "other")
    (other / WEIGHTS_FILE).write_bytes(b"other weights")
    config, learn = learn_configs(None, None, "", "", perception=first)

    def plan(perception: Path | None) -> LearnPlan:
        budget = Budget(minutes=1.0)
        return make_plan(
            ("embedded",), tmp_path / "run", config, learn, budget, avatars=None, seed=0, perception=perception
        )

    begun = plan(first)
    assert begun.recipe == "pretrained"
    with lock_folder(begun.out):
        write_state(begun, spent_s=1.0)
    assert plan(first) == begun
    for perception in (other, None):
        with pytest.raises(RunError, match="was begun with other perception, or with none"):
            plan(perception)
