"""The film of an expert's run: where everybody is, what the expert sees, expects and intends."""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from functools import partial

from readygo.apps.pictures.episode_film import EpisodeFilm, film_frames
from readygo.apps.run.config import RunConfig
from readygo.common.avatars import Avatar
from readygo.common.camera.lens import check_sensor
from readygo.common.dataset.reader import decode_image
from readygo.common.drawing.files import Picture
from readygo.common.drawing.plan_view import draw_scale_bar
from readygo.common.robot.kinematics import RATE_HZ
from readygo.common.scenes import Scene
from readygo.common.scenes.top_view import TopView
from readygo.services.planner import RobotPlanner
from readygo.services.planner.explain.journal import ExpertRun
from readygo.services.planner.explain.picture import episode_view
from readygo.services.planner.explain.picture_layers import draw_knowledge, draw_superseded
from readygo.services.renderer import Renderer, episode_samples

PIXELS_PER_M = 80
GIVEN_UP_STEPS = RATE_HZ
"""A plan that was given up stays in the film for this long."""


def run_film(planner: RobotPlanner, run: ExpertRun, camera: Iterable[Picture] | None = None) -> Iterator[Picture]:
    """Pictures of a run, 20 a second.

    Args:
        planner: Whose map, robot and settings the run had.
        run: The episode with its journal.
        camera: What the robot's camera sees, one image per step; shown beside the map.
    """
    trajectory, scenario = run.trajectory, run.scenario
    view = episode_view(planner.maps.robot, scenario, trajectory, motions=run.motions, pixels_per_m=PIXELS_PER_M)
    film = EpisodeFilm(
        title=f"{scenario.episode.episode_id}, {planner.ground.config.mode}",
        xyyaw=trajectory.xyyaw,
        actions=trajectory.actions,
        goal_xy_m=scenario.goal_xy_m,
        camera=camera,
        humans_xy_m=tuple(run.human_xy_m(k) for k in range(len(scenario.humans))),
        outcome=trajectory.outcome.value.replace("_", " "),
        underlay=partial(_underlay, planner, run),
        human_visible=trajectory.human_visible,
        replanned=trajectory.replanned,
        robot_radius_m=planner.robot.radius_m,
        human_radius_m=planner.episode_config.human_radius_m,
        success_radius_m=planner.episode_config.success_radius_m,
        v_max_mps=planner.robot.v_max_mps,
        w_max_radps=planner.robot.w_max_radps,
    )
    return film_frames(film, view)


def _underlay(planner: RobotPlanner, run: ExpertRun, picture: Picture, view: TopView, step: int) -> None:
    draw_knowledge(picture, view, planner, run, step)
    draw_superseded(picture, view, run, range(step - GIVEN_UP_STEPS, step + 1))
    draw_scale_bar(picture, view)


def camera_images(scene: Scene, avatars: Mapping[str, Avatar], config: RunConfig, run: ExpertRun) -> Iterator[Picture]:
    """What the robot's camera sees at every step, with the bytes that a run of this configuration records.

    Raises:
        ConfigError: If the robot's camera cannot have the sensor's lens.
    """
    check_sensor(config.renderer.sensor, config.robot.camera)
    seen = {human.avatar: avatars[human.avatar] for human in run.scenario.humans}
    only_rgb = dataclasses.replace(config.renderer, outputs=("rgb",))
    renderer = Renderer(scene=scene, avatars=seen, robot=config.robot, config=only_rgb)
    for sample in episode_samples(renderer, run.scenario, run.motions, run.trajectory):
        image = decode_image(sample.image)
        assert image is not None
        yield image
