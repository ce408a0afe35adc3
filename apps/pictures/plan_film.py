"""The film of a run: where everybody is, what the expert sees, expects and intends, and what the camera shows."""

from collections.abc import Iterator
from functools import partial

from readygo.apps.pictures.episode_film import EpisodeFilm, film_frames
from readygo.common.drawing.files import Picture
from readygo.common.drawing.plan_view import draw_scale_bar
from readygo.common.messages import EpisodeMotions, RobotTrajectory, Scenario
from readygo.common.scenes.top_view import TopView
from readygo.services.planner import RobotPlanner
from readygo.services.planner.explain.journal import DrivenRun
from readygo.services.planner.explain.picture import Look, episode_view
from readygo.services.planner.explain.picture_layers import draw_knowledge, draw_superseded
from readygo.services.renderer import Renderer
from readygo.services.renderer.samples import episode_shots

PIXELS_PER_M = 80
GIVEN_UP_S = 1.0
"""A plan that was given up stays in the film for this long [s]."""


def run_film(planner: RobotPlanner, run: DrivenRun, look: Look | None = None) -> Iterator[Picture]:
    """Pictures of a run, 20 a second.

    Args:
        planner: Whose map, robot and settings the run had.
        run: The episode with its journal.
        look: What the robot's camera shows, beside the map.
    """
    trajectory, scenario = run.trajectory, run.scenario
    view = episode_view(planner.maps.robot, scenario, trajectory, motions=run.motions, pixels_per_m=PIXELS_PER_M)
    film = EpisodeFilm(
        title=f"{scenario.episode.episode_id}, {planner.ground.config.mode if run.explained else run.driver}",
        xyyaw=trajectory.xyyaw,
        actions=trajectory.actions,
        goal_xy_m=scenario.goal_xy_m,
        camera=None if look is None else map(look, range(len(trajectory.xyyaw))),
        humans_xy_m=tuple(run.human_xy_m(k) for k in range(len(scenario.humans))),
        outcome=trajectory.outcome.value.replace("_", " "),
        underlay=partial(_underlay, planner, run),
        human_visible=trajectory.human_visible,
        replanned=trajectory.replanned,
        robot_radius_m=planner.robot.radius_m,
        human_radius_m=planner.episode_config.human_radius_m,
        success_radius_m=planner.episode_config.success_radius_m,
        rate_hz=planner.robot.clock.rate_hz,
        v_max_mps=planner.robot.v_max_mps,
        w_max_radps=planner.robot.w_max_radps,
    )
    return film_frames(film, view)


def _underlay(planner: RobotPlanner, run: DrivenRun, picture: Picture, view: TopView, step: int) -> None:
    draw_knowledge(picture, view, planner, run, step)
    draw_superseded(picture, view, run, range(step - planner.robot.clock.steps(GIVEN_UP_S), step + 1))
    draw_scale_bar(picture, view)


def robot_view(renderer: Renderer, scenario: Scenario, motions: EpisodeMotions, trajectory: RobotTrajectory) -> Look:
    """What the robot's camera shows at a run's steps: the images that `readygo generate` records, before JPEG.

    Raises:
        AvatarError: If a human wears an avatar that is not loaded.
    """
    shot_at = episode_shots(renderer, scenario, motions, trajectory)

    def look(step: int) -> Picture:
        (images,) = renderer.capture.take((shot_at(step),))
        return images.rgb

    return look
