import dataclasses

import numpy as np
import pytest

from readygo.apps.pictures import plan_film
from readygo.apps.pictures.plan_film import GIVEN_UP_S, RobotView, run_film
from readygo.apps.pictures.side_by_side import CAPTION_PX, GAP_PX
from readygo.common.avatars import load_avatars
from readygo.common.messages import Split
from readygo.runs.config import RunConfig
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.runs.world import World
from readygo.services.renderer import Renderer, RendererConfig
from tests.apps.pictures.test_perceived import FakePerception
from tests.common.policy.artifacts import ROBOT
from tests.services.planner.runs import STEPS, WAY, make_journal, make_run
from tests.services.planner.worlds import make_robot_planner


@pytest.fixture(scope="module")
def planner():
    return make_robot_planner(mode="paper")


def test_film_has_a_picture_per_step_and_shows_what_the_expert_sees(planner) -> None:
    pictures = list(run_film(planner, make_run([(0.0, 5.3)])))
    assert len(pictures) == STEPS
    assert len({picture.shape for picture in pictures}) == 1
    assert not np.array_equal(pictures[0], pictures[-1])


def test_plan_that_was_given_up_fades_after_a_second(planner, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = []
    monkeypatch.setattr(plan_film, "draw_superseded", lambda picture, view, run, steps: shown.append(steps))
    paths = [(WAY if k < 25 else WAY + np.array([0.0, 0.6]))[k:] for k in range(STEPS)]
    list(run_film(planner, make_run(journal=make_journal(paths, searches=(0, 25)))))
    assert [k for k, steps in enumerate(shown) if 25 in steps] == list(range(25, 25 + round(GIVEN_UP_S * 20) + 1))


@pytest.fixture(scope="module")
def two_cameras() -> Renderer:
    left = dataclasses.replace(ROBOT.camera, mount_yaw_deg=75.0)
    config = RunConfig(
        robot=dataclasses.replace(ROBOT, cameras={"left": left}), renderer=RendererConfig(outputs=("rgb", "depth"))
    )
    spec = make_spec(open_scene("embedded"), None, config, seed=1, split=Split.TRAIN, static=False)
    return World(spec).renderer()


def test_all_cameras_and_depths_are_shown_together_and_one_alone_as_it_is(two_cameras: Renderer) -> None:
    run, camera = make_run(), ROBOT.camera
    view = RobotView(two_cameras, run.scenario, run.motions, run.trajectory, width_px=200)
    scale = 200 // (2 * camera.width_px)
    height, width = 2 * (scale * camera.height_px + CAPTION_PX), 2 * scale * camera.width_px + GAP_PX
    assert not view.alone
    assert view(3).shape == (height, width, 3)
    assert not np.array_equal(view(3), view(40))
    only = Renderer(two_cameras.scene, load_avatars(), ROBOT, RendererConfig())
    alone = RobotView(only, run.scenario, run.motions, run.trajectory)
    assert alone.alone
    assert alone(3).shape == (camera.height_px, camera.width_px, 3)


def test_depths_that_a_policy_drives_by_are_shown_below(two_cameras: Renderer) -> None:
    run, camera = make_run(), ROBOT.camera
    only = Renderer(two_cameras.scene, load_avatars(), ROBOT, RendererConfig())
    view = RobotView(only, run.scenario, run.motions, run.trajectory, sees=("rgb", "depth"), width_px=camera.width_px)
    assert not view.alone
    assert view(3).shape == (2 * (camera.height_px + CAPTION_PX), camera.width_px, 3)


def test_film_shows_several_cameras_as_they_are(planner, two_cameras: Renderer) -> None:
    run = make_run()
    view = RobotView(two_cameras, run.scenario, run.motions, run.trajectory, width_px=600)
    together = view(0)
    frame = next(iter(run_film(planner, run, view)))
    places = [
        (top, side)
        for top in range(20)
        for side in range(20)
        if np.array_equal(frame[top:, side:][: len(together), : together.shape[1]], together)
    ]
    assert len(places) == 1


def test_what_is_perceived_is_marked_on_the_image_and_the_map_above_a_legend(planner, two_cameras: Renderer) -> None:
    run = make_run()
    only = Renderer(two_cameras.scene, load_avatars(), ROBOT, RendererConfig())
    plain, marked = (
        RobotView(only, run.scenario, run.motions, run.trajectory, perception=perception)
        for perception in (None, FakePerception(late=0))
    )
    assert plain.perceived is None
    assert marked(3).shape == (54 * ROBOT.camera.height_px, 54 * ROBOT.camera.width_px, 3)
    without, frame = (next(iter(run_film(planner, run, view))) for view in (plain, marked))
    assert frame.shape[1] == without.shape[1]
    assert len(frame) > len(without)
    assert len(frame) % 2 == 0
    above = frame[: len(without)]
    assert (above != without).any(axis=-1).sum() > 500


def test_what_is_perceived_is_marked_among_several_cameras(two_cameras: Renderer) -> None:
    run = make_run()
    plain, marked = (
        RobotView(two_cameras, run.scenario, run.motions, run.trajectory, perception=perception)
        for perception in (None, FakePerception(late=0))
    )
    assert not marked.alone
    assert marked(3).shape[1] == pytest.approx(plain(3).shape[1], abs=CAPTION_PX)
    assert len(np.unique(marked(3).reshape(-1, 3), axis=0)) > 10
