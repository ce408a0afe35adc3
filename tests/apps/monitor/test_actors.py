import math

import numpy as np

from readygo.apps.monitor.actors import Actor, eye_of
from readygo.apps.monitor.track import Track, track_of
from readygo.common.robot import RobotConfig
from tests.apps.monitor.fakes import Scene
from tests.apps.monitor.test_track import TWO_CAMERAS, recorded, recorded_by_two

ROBOT = RobotConfig()


def shown(track: Track) -> tuple[Scene, Actor]:
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
