import dataclasses

import numpy as np
import pytest

from readygo.apps.pictures.scene_findings import COLOURS, SHARE, findings_map
from readygo.apps.pictures.scene_maps import REACHABLE
from readygo.apps.views.views import Place, SceneViews
from readygo.common.drawing.files import Picture
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
    return SceneViews(places=(Place(looks=(look, look)),))


def has(picture: Picture, colour: tuple[float, ...]) -> bool:
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
