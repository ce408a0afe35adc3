import dataclasses

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.images.clarity import sharpness
from readygo.common.messages import EpisodeKey, RenderRequest, RenderView, Split
from readygo.common.robot.ranges import RobotRanges
from readygo.services.renderer import Renderer, look_around, unclear
from readygo.services.renderer.handlers import handle_render
from readygo.services.renderer.looks import BARE, BLURRED

EPISODE = EpisodeKey(seed=1, split=Split.TRAIN, index=3)
WAY = np.stack([0.05 * np.arange(20), np.zeros(20), 0.1 * np.arange(20)], axis=1)


def test_a_look_is_the_view_without_people(renderer: Renderer) -> None:
    (look,) = look_around(renderer, WAY[7:8])
    x_m, y_m, yaw_rad = look.xyyaw
    T_world_camera = renderer.robot.camera.T_world_camera(x_m, y_m, yaw_rad, renderer.scene.maps.floor.at(x_m, y_m))
    request = RenderRequest(views=(RenderView(T_world_camera=T_world_camera, people="", step=0),))
    assert np.array_equal(look.rgb, handle_render(renderer, request).rgb[0])
    assert look.sharpness == sharpness(look.rgb) > 0
    assert 0 < look.coverage <= 1


def test_nothing_is_drawn_unless_somebody_asks(renderer: Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renderer.rasterizers[""], "render", None)
    assert unclear(renderer, EPISODE, WAY, EpisodeConfig()) == ""


def test_episodes_that_show_too_little_are_named(renderer: Renderer) -> None:
    looks = list(look_around(renderer, WAY[[2, 6, 10, 14, 18]]))
    sharp, covered = np.median([look.sharpness for look in looks]), np.median([look.coverage for look in looks])
    enough = EpisodeConfig(sharpness_min=float(sharp), coverage_min=float(covered))
    assert unclear(renderer, EPISODE, WAY, enough) == ""
    assert unclear(renderer, EPISODE, WAY, EpisodeConfig(sharpness_min=float(sharp) + 0.1)) == BLURRED
    assert unclear(renderer, EPISODE, WAY, EpisodeConfig(coverage_min=min(1.0, float(covered) + 1e-6))) == (
        BARE if covered < 1.0 else ""
    )


def test_an_episode_is_looked_at_with_its_own_camera(renderer: Renderer) -> None:
    ranges = RobotRanges(mount_pitch_deg=(30.0, 60.0))
    own = Renderer(renderer.scene, {}, dataclasses.replace(renderer.robot, ranges=ranges), renderer.config)
    looks = list(look_around(own, WAY[[2, 6, 10, 14, 18]], EPISODE))
    assert not np.array_equal(looks[0].rgb, next(look_around(own, WAY[2:3])).rgb)
    sharp = float(np.median([look.sharpness for look in looks]))
    assert unclear(own, EPISODE, WAY, EpisodeConfig(sharpness_min=sharp)) == ""
    assert unclear(own, EPISODE, WAY, EpisodeConfig(sharpness_min=sharp + 0.1)) == BLURRED


def test_an_episode_of_one_step_is_looked_at_too(renderer: Renderer) -> None:
    assert unclear(renderer, EPISODE, WAY[:1], EpisodeConfig(sharpness_min=1e9)) == BLURRED
