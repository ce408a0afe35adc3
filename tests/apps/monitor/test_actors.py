import numpy as np

from readygo.apps.monitor.actors import Actor, eye_of
from readygo.apps.monitor.track import Track, track_of
from readygo.common.robot import RobotConfig
from tests.apps.monitor.fakes import Scene
from tests.apps.monitor.test_track import recorded

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
