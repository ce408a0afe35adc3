import dataclasses

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.camera.depth import depth_bytes, in_range
from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.errors import AvatarError
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages import EpisodeMotions, HumanMotion, Humans, RenderRequest, RenderView
from readygo.services.renderer import LiveCamera, Renderer, RendererConfig, episode_samples, handle_render
from readygo.services.renderer.sensor.recipes import SENSOR_RECIPES
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
    live = LiveCamera(renderer, simulation)
    seen = []
    while simulation.outcome is None:
        seen.append(live.take())
        simulation.advance(1.0, 1.5)
    scenario, motions, _ = episode
    samples = list(episode_samples(renderer, scenario, motions, simulation.trajectory()))
    assert [picture.image for picture in live.pictures.values()] == [sample.image for sample in samples]
    assert [picture.outputs for picture in live.pictures.values()] == [sample.outputs for sample in samples]
    assert len({picture.tobytes() for picture in seen}) == len(seen)


def test_unknown_avatar_is_refused_before_anybody_drives(renderer: Renderer, episode, human: HumanMotion) -> None:
    scenario, _, trajectory = episode
    stranger = EpisodeMotions(humans=(dataclasses.replace(human, avatar="stranger"),))
    with pytest.raises(AvatarError, match="'stranger' is not loaded"):
        LiveCamera(renderer, _simulation((scenario, stranger, trajectory), ROBOT))


def test_who_sees_depths_is_shown_them_and_they_are_those_that_views_have(renderer: Renderer, episode) -> None:
    simulation = _simulation(episode, ROBOT)
    live = LiveCamera(renderer, simulation, ("rgb", "depth"))
    sight = live.take()
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
