import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.apps.pictures.perceived import (
    FREE,
    PERCEIVED,
    PerceivedRun,
    draw_on_image,
    draw_on_map,
    free_colour,
    legend,
)
from readygo.common.camera.config import CameraConfig
from readygo.common.maps import GridFrame
from readygo.common.messages.live import LivePerception
from readygo.common.perception import Perceived
from readygo.common.perception.grid import SHAPE
from readygo.common.perception.people import CHANNELS, NOBODY
from readygo.common.robot import RobotConfig
from readygo.common.scenes.top_view import TopView
from tests.common.perception.test_live import CAMERA, EPISODE, perception


def image_with(told: LivePerception, scale: int = 3) -> np.ndarray:
    picture = np.full((scale * CAMERA.height_px, scale * CAMERA.width_px, 3), 128, np.uint8)
    draw_on_image(picture, told, CAMERA)
    return picture


def places_of(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    return np.argwhere((picture == colour).all(axis=-1))


def test_human_ahead_is_marked_in_the_middle_from_the_floor_up() -> None:
    told = perception()
    still = dataclasses.replace(told, tracks=())
    rows, columns = places_of(image_with(still), PERCEIVED).T
    focal, middle = 3 * float(CAMERA.K_px[0, 0]), 3 * CAMERA.width_px / 2
    assert columns.min() == pytest.approx(middle - 0.25 / 3.0 * focal, abs=3)
    assert columns.max() == pytest.approx(middle + 0.25 / 3.0 * focal, abs=3)
    # The camera is 0.5 m above the floor.
    assert rows.max() == pytest.approx(3 * CAMERA.height_px / 2 + 0.5 / 3.0 * focal, abs=3)
    # The track walks to the left.
    assert places_of(image_with(told), PERCEIVED)[:, 1].min() < columns.min() - 30


def test_humans_behind_the_camera_are_not_marked() -> None:
    told = perception()
    behind = dataclasses.replace(told.detections[0], xy_m=(1.0, 0.0))
    picture = image_with(dataclasses.replace(told, detections=(behind,), tracks=()))
    assert len(places_of(picture, PERCEIVED)) == 0


def test_strip_and_dots_show_the_free_distances() -> None:
    told = perception()
    rays_m = np.where(np.arange(SHAPE[1]) < 16, 0.0, 9.0).astype(np.float32)
    picture = image_with(dataclasses.replace(told, rays_m=rays_m))
    assert tuple(picture[-1, 0].tolist()) == free_colour(0.0)
    assert tuple(picture[-1, -1].tolist()) == free_colour(5.0)
    assert len(places_of(picture, FREE)) > 16


def test_map_shows_tracks_as_ellipses_and_the_free_space() -> None:
    told = perception()
    view = TopView(
        rgb=np.full((300, 300, 3), 255, np.uint8), frame=GridFrame(origin_x_m=-2.0, origin_y_m=1.0, resolution_m=0.02)
    )
    picture = view.rgb.copy()
    draw_on_map(picture, view, told, CAMERA)
    rows, _ = places_of(picture, PERCEIVED).T
    (track,) = told.tracks
    assert rows.mean() == pytest.approx(300 - (track.xy_m[1] - 1.0) / 0.02, abs=6)
    empty = view.rgb.copy()
    draw_on_map(empty, view, dataclasses.replace(told, tracks=()), CAMERA)
    assert (empty != 255).any(axis=-1).sum() > 100


def test_legend_can_be_drawn() -> None:
    picture = np.full((40, 40, 3), 255, np.uint8)
    for draw, text in legend():
        before = picture.copy()
        draw(picture, 20, 20)
        assert text
        assert not np.array_equal(before, picture)
        picture[:] = 255


class FakePerception:
    """Counts its looks; an image comes `late` steps after it was taken."""

    def __init__(self, late: int) -> None:
        self.late, self.looked, self.advanced = late, [], []
        self.perceived, self.pose = None, (0.0, 0.0, 0.0)
        self.people = SimpleNamespace(observe=lambda *_: [], tracker=SimpleNamespace(known=[]))

    def advance(self, command: tuple[float, float]) -> None:
        self.advanced.append(command)

    def arrives(self, step: int) -> bool:
        return True

    def is_due(self, step: int) -> bool:
        return step % 2 == 0

    def taken_at(self, step: int) -> int:
        return max(step - self.late, 0)

    def look(self, step: int, image: np.ndarray, command: tuple[float, float], pose: tuple[float, ...]) -> None:
        self.looked.append((step, int(image[0, 0, 0]), command))
        self.pose = pose
        self.perceived = Perceived(
            people=NOBODY,
            rays_m=np.full(SHAPE[1], float(step + 1)),
            rays_sd=np.ones(SHAPE[1]),
            answers=np.zeros((CHANNELS, *SHAPE)),
        )


def test_run_is_looked_at_step_by_step_with_the_latency_of_the_camera() -> None:
    steps = 6
    fake = FakePerception(late=1)
    trajectory = SimpleNamespace(
        xyyaw=np.array([(0.1 * k, 0.0, math.pi / 2) for k in range(steps)]),
        actions=np.array([(float(k), 0.0) for k in range(steps)]),
    )
    run = PerceivedRun(
        fake,
        EPISODE,
        trajectory,
        RobotConfig(camera=CameraConfig()),
        SimpleNamespace(at=lambda x, y: 0.25),
        lambda step: np.full((144, 256, 3), step, np.uint8),
    )
    told = run.at(5)
    assert fake.looked == [(0, 0, (0.0, 0.0)), (2, 1, (1.0, 0.0)), (4, 3, (3.0, 0.0))]
    assert fake.advanced == [(0.0, 0.0), *((float(k), 0.0) for k in range(5))]
    assert told.robot_xyzyaw == pytest.approx((0.3, 0.0, 0.25, math.pi / 2))
    assert told.rays_m[0] == 5.0
    # Earlier steps are remembered.
    assert run.at(3).rays_m[0] == 3.0
    assert len(fake.advanced) == steps
