"""The video of a run: robot and humans, the expert's view, predictions and plan, and the camera images."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

from readygo.apps.pictures.episode_film import CAMERA_HEIGHT_PX, EpisodeFilm, enlarge, film_frames
from readygo.apps.pictures.perceived import PerceivedRun, draw_on_image, draw_on_map, legend
from readygo.apps.pictures.side_by_side import ALONE, CAMERAS_WIDTH_PX, shown_images, side_by_side
from readygo.common.arrays import UInt8Array
from readygo.common.drawing.plan_view import draw_scale_bar
from readygo.common.episode.robot import robot_of_episode
from readygo.common.images.images import Images
from readygo.common.images.names import RGB
from readygo.common.messages import EpisodeMotions, RobotTrajectory, Scenario
from readygo.common.perception.episode import EpisodePerception
from readygo.common.scenes.top_view import TopView
from readygo.services.planner import (
    DrivenRun,
    RobotPlanner,
    TrackedHumans,
    draw_knowledge,
    draw_superseded,
    episode_view,
)
from readygo.services.renderer import Renderer, episode_shots, view_image

PIXELS_PER_M = 80
GIVEN_UP_S = 1.0
"""Time for which an abandoned plan stays in the video [s]."""


class RobotView:
    """The robot's camera images at a run's steps, as `readygo generate` records them, before JPEG."""

    def __init__(
        self,
        renderer: Renderer,
        scenario: Scenario,
        motions: EpisodeMotions,
        trajectory: RobotTrajectory,
        *,
        sees: Sequence[str] = (),
        width_px: int = CAMERAS_WIDTH_PX,
        perception: EpisodePerception[TrackedHumans] | None = None,
    ) -> None:
        """Mount the cameras on the robot.

        Args:
            renderer: Renderer with the cameras.
            scenario: Scenario of the run.
            motions: Motions of its humans.
            trajectory: Trajectory of the robot.
            sees: Further images to show, such as depths that a policy uses.
            width_px: Approximate width of several images together [px].
            perception: Marks what a network perceives on the first camera's image, which is enlarged.

        Raises:
            AvatarError: If a human wears an avatar that is not loaded.
        """
        self._names = tuple(dict.fromkeys((*renderer.recorded_images, *sees)))
        self._renderer, self._width_px = renderer, width_px
        self._rows = shown_images(self._names, renderer.robot)
        xyyaw = trajectory.xyyaw
        self._shots = episode_shots(renderer, scenario.episode, motions, xyyaw, range(len(xyyaw)))
        self.alone = self._rows == ALONE
        """True for one image at its size; several images are enlarged and have captions."""
        self._newest: tuple[int, Mapping[str, Images]] = (-1, {})
        self.perceived: PerceivedRun | None = None
        """What the network perceives at each step; None without one."""
        if perception is not None:
            robot, floor = robot_of_episode(renderer.robot, scenario.episode), renderer.scene.maps.floor
            self.perceived = PerceivedRun(
                perception, scenario.episode, trajectory, robot, floor, lambda step: self._views(step)[""].rgb
            )

    def __call__(self, step: int) -> UInt8Array:
        """Render the images of a step."""
        marked = self._mark(step)
        if self.alone:
            return self._views(step)[""].rgb if marked is None else marked
        views = self._views(step)
        images = {name: view_image(views, name) for row in self._rows for name in row}
        if marked is not None and RGB in images:
            images[RGB] = marked
        return side_by_side(images, self._rows, self._renderer.robot, width_px=self._width_px)

    def _views(self, step: int) -> Mapping[str, Images]:
        if self._newest[0] != step:
            (views,) = self._renderer.render([self._shots[step]], self._names)
            self._newest = step, views
        return self._newest[1]

    def _mark(self, step: int) -> UInt8Array | None:
        """The first camera's image, enlarged, with what is perceived; None without a network."""
        if self.perceived is None:
            return None
        perception = self.perceived.at(step)
        picture = enlarge(self._views(step)[""].rgb, CAMERA_HEIGHT_PX)
        draw_on_image(picture, perception, self.perceived.camera)
        return picture


def run_film(planner: RobotPlanner, run: DrivenRun, look: RobotView | None = None) -> Iterator[UInt8Array]:
    """Frames of a run's video, 20 per second.

    Args:
        planner: Planner with the run's map, robot and settings.
        run: The episode with its journal.
        look: View of the robot's cameras, beside the map; None without.
    """
    trajectory, scenario = run.trajectory, run.scenario
    perceived = None if look is None else look.perceived
    view = episode_view(planner.maps.robot, scenario, trajectory, motions=run.motions, pixels_per_m=PIXELS_PER_M)
    film = EpisodeFilm(
        title=f"{scenario.episode.episode_id}, {planner.ground.config.mode if run.explained else run.driver}",
        xyyaw=trajectory.xyyaw,
        actions=trajectory.actions,
        goal_xy_m=scenario.goal_xy_m,
        camera=None if look is None else map(look, range(len(trajectory.xyyaw))),
        enlarged=look is None or look.alone,
        humans_xy_m=tuple(run.human_xy_m(k) for k in range(len(scenario.humans))),
        outcome=trajectory.outcome.value.replace("_", " "),
        underlay=partial(_underlay, planner, run),
        overlay=None if perceived is None else partial(_overlay, perceived),
        legend=() if perceived is None else legend(),
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


def _underlay(planner: RobotPlanner, run: DrivenRun, picture: UInt8Array, view: TopView, step: int) -> None:
    draw_knowledge(picture, view, planner, run, step)
    draw_superseded(picture, view, run, range(step - planner.robot.clock.steps(GIVEN_UP_S), step + 1))
    draw_scale_bar(picture, view)


def _overlay(perceived: PerceivedRun, picture: UInt8Array, view: TopView, step: int) -> None:
    draw_on_map(picture, view, perceived.at(step), perceived.camera)
