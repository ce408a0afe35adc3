"""Levels of detail as a setting of the renderer."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.messages import HumanMotion, Motion
from readygo.common.rasterizer.lod import files as lod_files
from readygo.common.scenes import Scene
from readygo.services.renderer import Renderer, RendererConfig
from readygo.services.renderer import renderer as renderer_module
from tests.services.renderer.pictures import drawn
from tests.services.renderer.wearers import ROBOT


def rendered(scene: Scene, avatars: dict[str, Avatar], detail: str) -> np.ndarray:
    renderer = Renderer(scene, avatars, ROBOT, RendererConfig(detail=detail))
    name = next(iter(avatars))
    root = np.array([[2.5, 0.0, 0.95]], dtype=np.float32)
    motion = Motion(root_m=root, pose_axis_angle=np.zeros((1, 24, 3), dtype=np.float32))
    T = ROBOT.camera.T_world_camera(0.0, 0.0, 0.0, 0.0)
    return drawn(renderer, T, [HumanMotion(avatar=name, motion=motion)], 0).rgb


def test_lod_is_not_the_exact_image_but_much_like_it(scene: Scene, avatars: dict[str, Avatar]) -> None:
    exact, lod = (rendered(scene, avatars, detail).astype(np.float64) for detail in ("exact", "lod"))
    assert not np.array_equal(exact, lod)
    assert ((exact - lod) ** 2).mean() < 255**2 * 10**-3.5


def test_second_renderer_builds_nothing(scene: Scene, avatars: dict[str, Avatar], monkeypatch) -> None:
    first = {detail: rendered(scene, avatars, detail) for detail in ("exact", "lod")}

    def unwanted(*_: object) -> None:
        raise AssertionError("something was built again")

    for name in ("build_tree", "build_avatar_tree", "pack_avatar"):
        monkeypatch.setattr(lod_files, name, unwanted)
    for detail, image in first.items():
        assert np.array_equal(rendered(scene, avatars, detail), image)


def test_cache_belongs_to_the_content_of_scene_and_avatar(
    scene: Scene, avatars: dict[str, Avatar], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    people = tmp_path / "people"
    monkeypatch.setattr(renderer_module, "avatar_pack_folder", lambda: people)

    def folders(place: Path = scene.path / "cache") -> set[Path]:
        return {path for path in place.iterdir() if path.is_dir()}

    rendered(scene, avatars, "lod")
    before = folders()
    assert all(path.name.startswith(("lod-c0ffee", "packed-")) for path in before)
    assert len(folders(people)) == len(avatars)
    other = dataclasses.replace(scene, content_hash="decade" * 4)
    other.__dict__["maps"] = scene.maps
    rendered(other, avatars, "lod")
    assert {path.name for path in folders() - before} >= {"lod-decadedecadedeca-scene", "lod-decadedecadedeca-sky"}
    name, avatar = next(iter(avatars.items()))
    before = folders()
    rendered(scene, {name: dataclasses.replace(avatar, height_m=avatar.height_m + 0.01)}, "lod")
    assert folders() == before
    assert len(folders(people)) == len(avatars) + 1


def test_renderer_holds_no_gaussians_of_its_avatars(
    renderer: Renderer, avatars: dict[str, Avatar], human: HumanMotion
) -> None:
    other = Renderer(renderer.scene, avatars, ROBOT, RendererConfig(contact_shadow=True))
    assert [len(avatar.cloud) for avatar in other.skeletons.values()] == [0] * len(avatars)
    assert all(len(avatar.cloud) for avatar in avatars.values())
    T = ROBOT.camera.T_world_camera(0.0, 0.0, 0.0, 0.0)
    assert not np.array_equal(drawn(other, T, [human], 1).rgb, drawn(renderer, T, [human], 1).rgb)


@pytest.mark.parametrize(("settings", "message"), [
    ({"detail": "coarse"}, "detail must be"),
    ({"detail": "lod", "backend": "reference"}, "backend cpu only"),
])  # fmt: skip
def test_detail_that_cannot_be_drawn_is_refused(settings: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RendererConfig(**settings)
