import dataclasses

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.camera.depth import depth_bytes, in_range
from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.episode.loop import EpisodeRun
from readygo.common.errors import AvatarError
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages import EpisodeMotions, HumanMotion, Humans, RenderRequest, RenderView
from readygo.services.renderer import SENSOR_RECIPES, LiveCamera, Renderer, RendererConfig, episode_samples
from readygo.services.renderer.handlers import handle_render
from tests.services.renderer.wearers import ROBOT


def _simulation(episode, robot) -> EpisodeSimulation:
    scenario, motions, _ = episode
    frame = GridFrame(origin_x_m=-6.0, origin_y_m=-6.0, resolution_m=0.1)
    free = OccupancyMap(frame=frame, occupied=np.zeros((120, 120), np.bool_))
    config = EpisodeConfig(time_limit_s=0.5, success_radius_m=0.3)
    return EpisodeSimulation(scenario, motions, free, robot, config)


@pytest.mark.parametrize("moves_while_it_looks", [False, True])
def test_pictures_are_those_of_the_finished_trajectory(
    renderer: Renderer, avatars: dict[str, Avatar], episode, moves_while_it_looks: bool
) -> None:
    camera, config = ROBOT.camera, RendererConfig(outputs=("rgb", "depth"))
    if moves_while_it_looks:
        camera, config = SENSOR_RECIPES["sensor_phone_like"](camera, config)
    robot = dataclasses.replace(ROBOT, camera=camera)
    renderer = Renderer(renderer.scene, avatars, robot, config)
    simulation = _simulation(episode, robot)
    live = LiveCamera(renderer)
    run, seen = EpisodeRun(simulation, [live]), []
    while not run.ended:
        seen.append(live.look([simulation])[0])
        run.advance((1.0, 1.5))
    scenario, motions, _ = episode
    samples = list(episode_samples(renderer, scenario, motions, simulation.trajectory()))
    assert [picture.image for picture in live.pictures.values()] == [sample.image for sample in samples]
    assert [picture.outputs for picture in live.pictures.values()] == [sample.outputs for sample in samples]
    assert len({picture.tobytes() for picture in seen}) == len(seen)


def test_unknown_avatar_is_refused_before_anybody_drives(renderer: Renderer, episode, human: HumanMotion) -> None:
    scenario, _, trajectory = episode
    stranger = EpisodeMotions(humans=(dataclasses.replace(human, avatar="stranger"),))
    with pytest.raises(AvatarError, match="'stranger' is not loaded"):
        EpisodeRun(_simulation((scenario, stranger, trajectory), ROBOT), [LiveCamera(renderer)])


def test_who_sees_depths_is_shown_them_and_they_are_those_that_views_have(renderer: Renderer, episode) -> None:
    simulation = _simulation(episode, ROBOT)
    live = LiveCamera(renderer, ("rgb", "depth"))
    EpisodeRun(simulation, [live])
    sight = live.look([simulation])[0]
    camera, pose = ROBOT.camera, simulation.path_xyyaw(0, 0)[0].tolist()
    floor_m = renderer.scene.maps.floor.at(*pose[:2])
    view = RenderView(people="", step=0, T_world_camera=camera.T_world_camera(*pose, floor_m))
    people = Humans(key="people", humans=episode[1].humans)
    request = RenderRequest(views=(dataclasses.replace(view, people="people"),), people=(people,), outputs=("depth",))
    reply = handle_render(renderer, request)
    depth_m = reply.outputs["depth"][0]
    assert np.array_equal(sight[..., :3], reply.rgb[0])
    assert np.array_equal(sight[..., 3], depth_bytes(in_range(depth_m, camera), camera))
    assert len(np.unique(sight[..., 3])) > 5
    assert live.pictures[0].outputs == {}


@pytest.mark.parametrize(
    ("latency_s", "image_every", "seen"),
    [(0.0, 1, [0, 1, 2, 3, 4, 5]), (0.1, 1, [0, 0, 0, 1, 2, 3]), (0.15, 3, [0, 0, 0, 0, 0, 0, 3])],
)
def test_driver_gets_each_image_by_the_cameras_latency_later(
    renderer: Renderer, episode, latency_s: float, image_every: int, seen: list[int]
) -> None:
    robot = dataclasses.replace(ROBOT, camera=dataclasses.replace(ROBOT.camera, latency_s=latency_s))
    simulation = _simulation(episode, robot)
    camera = LiveCamera(renderer, image_every=image_every)
    run, looks, arrived = EpisodeRun(simulation, [camera]), [], []
    for _ in seen:
        looks.append(camera.look([simulation])[0].tobytes())
        arrived.append(camera.arrives(simulation))
        run.advance((1.0, 1.5))
    drawn, of_step = LiveCamera(renderer), {}
    instant = dataclasses.replace(ROBOT, camera=dataclasses.replace(ROBOT.camera, latency_s=0.0))
    again = EpisodeRun(_simulation(episode, instant), [drawn])
    for step in range(len(seen)):
        of_step[step] = drawn.look([again.simulation])[0].tobytes()
        again.advance((1.0, 1.5))
    assert looks == [of_step[step] for step in seen]
    late = simulation.clock.steps(latency_s)
    assert arrived == [step == 0 or (step - late) % image_every == 0 for step in range(len(seen))]
    assert sorted(camera.pictures) == [step for step in range(simulation.step + 1) if step % image_every == 0]


def test_camera_keeps_no_images_for_a_driver_that_does_not_look(renderer: Renderer, episode) -> None:
    robot = dataclasses.replace(ROBOT, camera=dataclasses.replace(ROBOT.camera, latency_s=0.1))
    simulation = _simulation(episode, robot)
    camera = LiveCamera(renderer)
    run = EpisodeRun(simulation, [camera])
    while not run.ended:
        run.advance((1.0, 1.5))
    assert len(camera.pictures) == simulation.step > 5
    assert len(camera._waiting) == 1 + simulation.clock.steps(0.1)
