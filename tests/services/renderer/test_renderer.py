from dataclasses import replace

import numpy as np
import pytest

from readygo.common.errors import AvatarError
from readygo.common.messages import HumanMotion, Humans
from readygo.common.rasterizer.backends import packed_cloud
from readygo.services.renderer import Renderer, RendererConfig
from readygo.services.renderer import renderer as renderer_module
from readygo.services.renderer.drawing import pack_folder, static_clouds
from tests.services.renderer.asking import render, view
from tests.services.renderer.wearers import wearers


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
    names = sorted(path.name for path in (scene.path / "cache").iterdir())
    assert names == ["packed-c0ffeec0ffeec0ff-scene", "packed-c0ffeec0ffeec0ff-sky"]
    (scene.path / "scene.ply").unlink()
    again = [packed_cloud(cloud, pack_folder(scene)) for cloud in static_clouds(scene)]
    assert [pack.chunk_count for pack in again] == [pack.chunk_count for pack in packs]
