import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud
from readygo.common.messages import HumanMotion
from readygo.common.scenes import Scene
from readygo.services.renderer import Renderer, RendererConfig
from readygo.services.renderer.drawing import Drawing, make_drawing, static_clouds
from tests.services.renderer.conftest import ROBOT

CAMERA = ROBOT.camera
POSE = CAMERA.T_world_camera(0.0, 0.0, 0.3, 0.0)


def test_scene_and_sky_are_the_clouds_and_are_loaded_when_asked_for(scene: Scene) -> None:
    clouds = static_clouds(scene)
    assert [cloud.key for cloud in clouds] == ["c0ffeec0ffeec0ff-scene", "c0ffeec0ffeec0ff-sky"]
    assert [len(cloud.load()) for cloud in clouds] == [4000, 500]
    (scene.path / "sky.ply").unlink()
    del scene.metadata["files"]["sky.ply"]
    assert [cloud.key for cloud in static_clouds(scene)] == ["c0ffeec0ffeec0ff-scene"]


def test_view_shows_the_humans_of_its_step(renderer: Renderer, human: HumanMotion) -> None:
    view = renderer.drawing.view(POSE, (human,), 1.5)
    (there,) = view.humans
    assert there.avatar == human.avatar
    assert there.root_m[1] == pytest.approx(-0.15)
    assert np.array_equal(view.T_world_camera, POSE)


def test_shadows_are_those_of_the_view(scene: Scene, avatars: dict[str, Avatar], human: HumanMotion) -> None:
    drawing = make_drawing(scene, avatars, CAMERA, RendererConfig(contact_shadow=True))
    assert isinstance(drawing.view(POSE, (human,), 0).shadows, GaussianCloud)
    assert drawing.view(POSE, (), 0).shadows is None
    off = make_drawing(scene, avatars, CAMERA, RendererConfig(contact_shadow=False))
    assert off.view(POSE, (human,), 0).shadows is None


def test_feet_have_a_lead_on_the_ground_below_them_unless_switched_off(
    scene: Scene, avatars: dict[str, Avatar], human: HumanMotion
) -> None:
    on, off = (make_drawing(scene, avatars, CAMERA, RendererConfig(feet_on_floor=feet)) for feet in (True, False))
    (there,) = on.view(POSE, (human,), 0).humans
    assert there.ground_m == pytest.approx(scene.maps.floor.at(*there.root_m[:2].tolist()), abs=0.01)
    assert 0.0 < there.lead_m < 0.5
    assert off.view(POSE, (human,), 0).humans[0].lead_m == 0.0


def test_humans_are_lit_where_they_are_and_not_at_all_when_switched_off(
    scene: Scene, avatars: dict[str, Avatar], human: HumanMotion
) -> None:
    lit, off = (make_drawing(scene, avatars, CAMERA, RendererConfig(human_light=light)) for light in (True, False))
    (cache,) = scene.path.glob("cache/light-*.npz")
    assert cache.name == "light-c0ffeec0ffeec0ff.npz"
    assert off.view(POSE, (human,), 0).humans[0].light is None
    here, there = (lit.view(POSE, (human,), step).humans[0].light for step in (0, 3))
    assert lit.probes is not None
    assert np.array_equal(here, lit.probes.at(*(float(value) for value in human.motion.root_m[0, :2])))
    assert not np.array_equal(here, there)


def test_backend_is_that_of_the_config(scene: Scene, avatars: dict[str, Avatar], human: HumanMotion) -> None:
    fast, slow = (
        make_drawing(scene, avatars, CAMERA, RendererConfig(backend=backend)) for backend in ("cpu", "reference")
    )
    images = [one.rasterizer.render([one.view(POSE, (human,), 1)]).rgb.astype(int) for one in (fast, slow)]
    assert isinstance(fast, Drawing)
    assert type(fast.rasterizer) is not type(slow.rasterizer)
    assert np.abs(images[0] - images[1]).mean() < 0.1
