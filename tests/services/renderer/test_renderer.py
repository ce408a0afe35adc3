from dataclasses import replace

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.errors import AvatarError, ConfigError, RunError
from readygo.common.gaussians import GaussianCloud
from readygo.common.messages import EpisodeKey, HumanMotion, Humans, Split
from readygo.common.rasterizer.backends import packed_cloud
from readygo.common.robot import RobotConfig
from readygo.common.robot.ranges import RobotRanges
from readygo.common.scenes import Scene
from readygo.services.renderer import Renderer, RendererConfig, Shot, pack_folder, static_clouds
from readygo.services.renderer import renderer as renderer_module
from readygo.services.renderer.renderer import scene_light
from tests.services.renderer.asking import render, view
from tests.services.renderer.pictures import Watched, drawn, view_of
from tests.services.renderer.wearers import ROBOT, wearers

CAMERA = ROBOT.camera
POSE = CAMERA.T_world_camera(0.0, 0.0, 0.3, 0.0)


def test_humans_asked_for_longest_ago_are_forgotten(
    renderer: Renderer, human: HumanMotion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(renderer_module, "HUMANS_KEPT", 2)
    for key in ("a", "b"):
        render(renderer, view(renderer, key), people=(Humans(key=key, humans=(human,)),))
    render(renderer, view(renderer, "a"))
    render(renderer, view(renderer, "c"), people=(Humans(key="c", humans=(human,)),))
    assert render(renderer, view(renderer, "b")).unknown_people == ("b",)
    assert render(renderer, view(renderer, "a"), view(renderer, "c")).unknown_people == ()


def test_unknown_avatar_is_refused_by_name(renderer: Renderer, human: HumanMotion) -> None:
    stranger = replace(human, avatar="stranger")
    with pytest.raises(AvatarError, match="'stranger' is not loaded"):
        render(renderer, people=(Humans(key="x", humans=(stranger,)),))


def test_reference_backend_draws_the_same(renderer: Renderer, human: HumanMotion) -> None:
    reference = Renderer(renderer.scene, wearers(), renderer.robot, RendererConfig(backend="reference"))
    people = (Humans(key="walk", humans=(human,)),)
    slow, fast = (render(r, view(r, "walk", 1), people=people).rgb.astype(int) for r in (reference, renderer))
    # The avatar's quantised coordinates give some Gaussians almost equal depths, whose order may differ.
    assert (np.abs(slow - fast) > 2).mean() < 0.01
    assert np.abs(slow - fast).mean() < 0.1


def test_sky_is_drawn_and_both_packs_are_cached(scene, renderer: Renderer) -> None:
    packs = [packed_cloud(cloud, pack_folder(scene)) for cloud in static_clouds(scene)]
    names = sorted(path.name for path in (scene.path / "cache").iterdir() if path.is_dir())
    assert names == ["packed-c0ffeec0ffeec0ff-scene", "packed-c0ffeec0ffeec0ff-sky"]
    (scene.path / "scene.ply").unlink()
    again = [packed_cloud(cloud, pack_folder(scene)) for cloud in static_clouds(scene)]
    assert [pack.chunk_count for pack in again] == [pack.chunk_count for pack in packs]


def test_scene_and_sky_are_the_clouds_and_are_loaded_when_asked_for(scene: Scene) -> None:
    clouds = static_clouds(scene)
    assert [cloud.key for cloud in clouds] == ["c0ffeec0ffeec0ff-scene", "c0ffeec0ffeec0ff-sky"]
    assert [len(cloud.load()) for cloud in clouds] == [4000, 500]
    (scene.path / "sky.ply").unlink()
    del scene.metadata["files"]["sky.ply"]
    assert [cloud.key for cloud in static_clouds(scene)] == ["c0ffeec0ffeec0ff-scene"]


def test_view_shows_the_humans_of_its_step(renderer: Renderer, human: HumanMotion) -> None:
    view = view_of(renderer, POSE, (human,), 1.5)
    (there,) = view.humans
    assert there.avatar == human.avatar
    assert there.root_m[1] == pytest.approx(-0.15)
    assert np.array_equal(view.T_world_camera, POSE)


def test_shadows_are_those_of_the_view(scene: Scene, avatars: dict[str, Avatar], human: HumanMotion) -> None:
    shadowed = Renderer(scene, avatars, ROBOT, RendererConfig(contact_shadow=True))
    assert isinstance(view_of(shadowed, POSE, (human,), 0).shadows, GaussianCloud)
    assert view_of(shadowed, POSE, (), 0).shadows is None
    off = Renderer(scene, avatars, ROBOT, RendererConfig(contact_shadow=False))
    assert view_of(off, POSE, (human,), 0).shadows is None


def test_feet_have_a_lead_on_the_ground_below_them_unless_switched_off(
    scene: Scene, avatars: dict[str, Avatar], human: HumanMotion
) -> None:
    on, off = (Renderer(scene, avatars, ROBOT, RendererConfig(feet_on_floor=feet)) for feet in (True, False))
    (there,) = view_of(on, POSE, (human,), 0).humans
    assert there.ground_m == pytest.approx(scene.maps.floor.at(*there.root_m[:2].tolist()), abs=0.01)
    assert 0.0 < there.lead_m < 0.5
    assert view_of(off, POSE, (human,), 0).humans[0].lead_m == 0.0


def test_humans_are_lit_where_they_are_and_not_at_all_when_switched_off(
    scene: Scene, avatars: dict[str, Avatar], human: HumanMotion
) -> None:
    lit, off = (Renderer(scene, avatars, ROBOT, RendererConfig(human_light=light)) for light in (True, False))
    (cache,) = scene.path.glob("cache/light-*.npz")
    assert cache.name == "light-c0ffeec0ffeec0ff.npz"
    assert view_of(off, POSE, (human,), 0).humans[0].light is None
    here, there = (view_of(lit, POSE, (human,), step).humans[0].light for step in (0, 3))
    light = scene_light(scene, lit.config)
    assert light is not None
    assert np.array_equal(here, light(*(float(value) for value in human.motion.root_m[0, :2])))
    assert not np.array_equal(here, there)


def test_backend_is_that_of_the_config(scene: Scene, avatars: dict[str, Avatar], human: HumanMotion) -> None:
    fast, slow = (Renderer(scene, avatars, ROBOT, RendererConfig(backend=backend)) for backend in ("cpu", "reference"))
    images = [drawn(one, POSE, (human,), 1).rgb.astype(int) for one in (fast, slow)]
    assert type(fast.rasterizers[""]) is not type(slow.rasterizers[""])
    assert np.abs(images[0] - images[1]).mean() < 0.1


def test_ideal_camera_shows_what_the_rasterizer_draws(scene: Scene, avatars: dict[str, Avatar]) -> None:
    ideal = Renderer(scene, avatars, ROBOT, RendererConfig())
    ideal.rasterizers[""] = watched = Watched(ideal.rasterizers[""])
    image = drawn(ideal, POSE, (), 1)
    assert [image.rgb.tobytes()] == [one.rgb.tobytes() for one in watched.images]


def test_cameras_of_equal_pinholes_share_a_rasterizer(scene: Scene) -> None:
    cameras = {"left": replace(CAMERA, mount_yaw_deg=90.0), "rear": replace(CAMERA, distortion="fisheye")}
    several = Renderer(scene, {}, RobotConfig(camera=CAMERA, cameras=cameras), RendererConfig(human_light=False))
    assert several.rasterizers["left"] is several.rasterizers[""]
    assert several.rasterizers["rear"] is not several.rasterizers[""]


def test_latest_cameras_are_kept_and_a_lens_is_worked_out_once(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renderer_module, "EPISODE_CAMERAS_KEPT", 2)
    robot = RobotConfig(camera=replace(CAMERA, distortion="fisheye"))
    bent = Renderer(scene, {}, robot, RendererConfig(human_light=False))
    episodes = [EpisodeKey(seed=0, split=Split.TRAIN, index=index) for index in range(3)]
    first, second, third = (bent.episode_camera("", episode) for episode in episodes)
    assert first.remap is second.remap is third.remap is not None
    assert bent.episode_camera("", episodes[2]) is third
    assert bent.episode_camera("", episodes[0]) is not first


def test_unknown_camera_is_refused_by_name(renderer: Renderer) -> None:
    shot = Shot(step=0, pose_at=lambda *_: POSE)
    with pytest.raises(RunError, match="no camera 'left'; it has front"):
        next(renderer.render([shot], ("rgb", "left.rgb")))


def test_robot_whose_cameras_the_backend_cannot_draw_is_refused_before_anything_is_loaded(scene: Scene) -> None:
    robot = RobotConfig(
        camera=replace(CAMERA, horizontal_fov_deg=90.0), ranges=RobotRanges(horizontal_fov_deg=(80.0, 100.0))
    )
    with pytest.raises(ConfigError, match=r"ranges\.horizontal_fov_deg: the backend triton draws one field of view"):
        Renderer(scene, {}, robot, RendererConfig(backend="triton", human_light=False))
