import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from readygo.apps.monitor.actors import LIFT_M, Actor, eye_of, track_segments
from readygo.apps.monitor.track import EpisodeTrack, track_of
from readygo.common.robot import RobotConfig
from tests.apps.monitor.fakes import Scene
from tests.apps.monitor.test_track import TWO_CAMERAS, recorded, recorded_by_two
from tests.common.perception.test_live import perception

ROBOT = RobotConfig()


def shown(track: EpisodeTrack) -> tuple[Scene, Actor]:
    scene = Scene()
    actor = Actor(scene, "/robots/0", ROBOT, (1, 2, 3))
    actor.plan(track.way, track.replans, of=track.episode)
    actor.show(track.states[0], "#0")
    return scene, actor


def test_everybody_is_where_the_state_says() -> None:
    track = track_of(recorded())
    scene, actor = shown(track)
    state = track.states[0]
    assert scene.nodes["/robots/0/robot"].position == state.robot_xyzyaw[:3]
    assert scene.nodes["/robots/0/goal"].position[:2] == state.goal_xy_m
    humans = [name for name in scene.nodes if name.startswith("/robots/0/human") and name.endswith("/body")]
    assert len(humans) == len(state.humans_xyzyaw)
    assert any(name.startswith("/robots/0/robot/fan") for name in scene.nodes), "the field of view"
    actor.hide()
    assert not [name for name in scene.nodes if "/robots/0/" in name and "body" not in name]


def test_every_camera_has_its_field_of_view_and_its_picture() -> None:
    track = track_of(recorded_by_two())
    scene = Scene()
    actor = Actor(scene, "/robots/0", TWO_CAMERAS, (1, 2, 3))
    actor.show(track.states[0], "#0")
    fans = {name: node.wxyz for name, node in scene.nodes.items() if "/robot/fan" in name}
    assert len(fans) == 6
    quarter_left = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    np.testing.assert_allclose(fans["/robots/0/robot/fanleft0"], quarter_left, atol=1e-12)
    picture = np.ones((16, 20, 3), np.uint8)
    actor.picture("left", picture)
    assert scene.nodes["/robots/0/robot/body/viewleft"].image is picture
    actor.hide()
    actor.picture("left", picture)


def test_what_is_perceived_lies_on_the_floor_and_goes() -> None:
    track = track_of(recorded())
    scene, actor = shown(track)
    told = perception()
    actor.perceive(told)
    floor_m = told.robot_xyzyaw[2]
    tracks, free = (scene.nodes[f"/robots/0/{name}"] for name in ("tracks", "free"))
    np.testing.assert_allclose(tracks.points[..., 2], floor_m + LIFT_M, atol=1e-6)
    np.testing.assert_allclose(free.points[..., 2], floor_m + LIFT_M, atol=1e-6)
    place = np.array(told.tracks[0].xy_m)
    assert np.abs(tracks.points[..., :2] - place).max() < 1.5
    standing = dataclasses.replace(told, tracks=(dataclasses.replace(told.tracks[0], v_mps=(0.0, 0.0)),))
    assert len(track_segments(standing)) == len(tracks.points) - 3
    actor.perceive(dataclasses.replace(told, tracks=()))
    assert "/robots/0/tracks" not in scene.nodes
    actor.perceive(None)
    assert "/robots/0/free" not in scene.nodes


def test_who_looks_out_of_the_robot_does_not_see_it() -> None:
    track = track_of(recorded())
    scene, actor = shown(track)
    actor.eyes = True
    actor.show(track.states[1], "#0")
    assert not scene.nodes["/robots/0/robot/body"].visible
    T_world_camera = eye_of(ROBOT.camera, track.states[0])
    x, y, z, yaw = track.states[0].robot_xyzyaw
    np.testing.assert_allclose(T_world_camera, ROBOT.camera.T_world_camera(x, y, yaw, z))


def test_nobody_is_left_of_those_who_are_gone() -> None:
    track = track_of(recorded())
    scene, actor = shown(track)
    count = len(scene.nodes)
    for _ in range(3):
        for state in track.states:
            actor.show(state, "#0")
    assert len(scene.nodes) <= count + 1, "only a trail may come to it"


class MeasuredScene(Scene):
    """Keeps the size and the colour of what is added."""

    def _add(self, name: str, *arguments: Any, **values: Any) -> Any:
        arrays = [argument for argument in arguments if isinstance(argument, np.ndarray) and argument.dtype.kind == "f"]
        if arrays:
            values["bounds"] = np.concatenate([arrays[0].min(axis=0), arrays[0].max(axis=0)])
        return super()._add(name, *arguments, **values)

    add_frame = add_mesh_simple = add_camera_frustum = _add

    def add_line_segments(self, name: str, points: Any, colors: Any, **values: Any) -> Any:
        return self._add(name, points=points, colors=colors, **values)

    def lines(self) -> list[str]:
        found = []
        for name, node in sorted(self.nodes.items()):
            values = {key: value for key, value in vars(node).items() if key not in ("name", "_scene", "_acts")}
            words = (f"{key}={_rounded(value)}" for key, value in sorted(values.items()))
            found.append(f"{name}: {', '.join(words)}")
        return found


def _rounded(value: Any) -> str:
    if isinstance(value, (np.ndarray, tuple, list, float)):
        return str((np.round(np.asarray(value, float), 3) + 0.0).tolist())
    return str(value)


def test_everything_is_where_it_was(golden_page: Callable[[str, str], None]) -> None:
    scene = MeasuredScene()
    actor = Actor(scene, "/robots/0", TWO_CAMERAS, (10, 120, 250))
    track = track_of(recorded_by_two())
    way = np.array([[-3.2, 7.1, 0.3], [-3.0, 7.5, 0.3], [-2.99, 7.51, 0.3], [-2.0, 8.0, 0.35]])
    humans = tuple(way + np.array([shift, -shift, 0.0]) for shift in (0.5, 1.5))
    first = dataclasses.replace(
        track.states[0], robot_xyzyaw=(-3.2, 7.1, 0.3, 2.5), goal_xy_m=(-2.0, 8.5), horizontal_fov_rad=1.9,
        humans_xyzyaw=((1.0, 2.0, 0.1, -0.7), (3.0, -4.0, 0.2, 2.1)),
    )  # fmt: skip
    actor.plan(way, way[1:2], humans, of="a")
    actor.show(first, "#7")
    actor.show(dataclasses.replace(first, robot_xyzyaw=(-3.2, 7.16, 0.3, 2.4)), "#8")
    actor.show(dataclasses.replace(first, robot_xyzyaw=(-3.2, 7.2, 0.3, 2.4), humans_xyzyaw=()), "#8")
    lines = ["two steps:", *scene.lines()]
    actor.plan(way * 2, way, of="a")
    assert lines[1:] == scene.lines(), "the same ways are not drawn again"
    actor.plan(way[:0], way[:0], (), of="b")
    actor.show(dataclasses.replace(first, horizontal_fov_rad=1.2), "#9", trail=False)
    golden_page("monitor_actor", "\n".join([*lines, "", "another plan:", *scene.lines()]))


def test_trail_has_a_point_every_5_cm_and_begins_anew_after_a_leap() -> None:
    scene = MeasuredScene()
    actor = Actor(scene, "/r", ROBOT, (1, 2, 3))
    state = track_of(recorded()).states[0]

    def go(x_m: float) -> int:
        actor.show(dataclasses.replace(state, robot_xyzyaw=(x_m, 0.0, 0.0, 0.0)), "")
        return len(scene.nodes["/r/trail"].points) if "/r/trail" in scene.nodes else 0

    assert [go(x) for x in (0.0, 0.04, 0.051, 0.1, 0.15, 1.64, 3.2, 3.3)] == [0, 0, 1, 1, 2, 3, 0, 1]
    for k in range(500):
        count = go(3.3 + 0.06 * k)
    assert count == 399
