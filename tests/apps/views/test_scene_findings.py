import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from readygo.apps.pictures.scene_maps import REACHABLE
from readygo.apps.views.scene_findings import COLOURS, SHARE, findings_map
from readygo.apps.views.views import SceneViews, ViewPlace
from readygo.common.arrays import UInt8Array
from readygo.common.gaussians import concatenate
from readygo.common.maps import MapConfig, ScenePlan, plan_scene
from readygo.common.scenes.findings import UNFILMED
from readygo.services.renderer import Look
from tests.common.maps.room import sheet


@pytest.fixture(scope="module")
def plan() -> ScenePlan:
    guessed = sheet((4, 0, 0), (3, 0, 0), (0, 3, 0), spacing_m=0.8)
    return plan_scene(concatenate([sheet((0, 0, 0), (4, 0, 0), (0, 3, 0)), guessed]), MapConfig())


def seen(sharpness: float) -> SceneViews:
    look = Look(xyyaw=(1.0, 1.0, 0.0), rgb=np.zeros((8, 8, 3), np.uint8), sharpness=sharpness, coverage=1.0)
    return SceneViews(places=(ViewPlace(looks=(look, look)),))


def has(picture: UInt8Array, colour: tuple[float, ...]) -> bool:
    return bool((np.abs(picture.astype(int) - np.rint(colour).astype(int)) <= 1).all(axis=2).sum() > 100)


def test_ground_that_nobody_filmed_is_coloured_and_the_sentences_stand_below(plan: ScenePlan) -> None:
    tint = tuple((1 - SHARE) * a + SHARE * b for a, b in zip(REACHABLE, COLOURS[UNFILMED], strict=True))
    picture = findings_map(plan, seen(500.0), [], "room", 0.3)
    assert has(picture, tint)
    sound = dataclasses.replace(plan, coarse=np.zeros_like(plan.coarse), blurred=np.zeros_like(plan.blurred))
    assert not has(findings_map(sound, seen(500.0), [], "room", 0.3), tint)
    assert len(findings_map(plan, seen(500.0), ["word " * 200], "room", 0.3)) > len(picture)


def test_places_in_fog_are_numbered(plan: ScenePlan) -> None:
    sharp, foggy = (findings_map(plan, seen(value), [], "room", 0.3) for value in (500.0, 1.0))
    assert not np.array_equal(sharp[:700], foggy[:700])


def test_map_looks_as_it_did(
    plan: ScenePlan, golden_image: Callable[[str, UInt8Array], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    blurred, coarse = np.zeros_like(plan.blurred), plan.coarse.copy()
    blurred[20:40, 8:30] = True
    coarse[30:50, 25:60] = False
    crooked = dataclasses.replace(plan, blurred=blurred, coarse=coarse)
    bare = Look(xyyaw=(2.6, 0.7, 0.4), rgb=np.zeros((8, 8, 3), np.uint8), sharpness=900.0, coverage=0.1)
    places = (seen(500.0).places[0], seen(3.0).places[0], ViewPlace(looks=(bare, bare)))
    monkeypatch.setattr("readygo.apps.views.scene_findings.HEIGHT_PX", 260)
    high = findings_map(crooked, SceneViews(places=places), ["a wall is blurred", "long " * 40], "room", 0.3)
    golden_image("scene_findings", high)
    monkeypatch.setattr("readygo.apps.views.scene_findings.WIDTH_MAX_PX", 150)
    golden_image("scene_findings_narrow", findings_map(crooked, seen(500.0), [], "room", 0.3))
