"""The film of an episode: it plays back, and shows what happened where."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.apps.pictures.episode_film import EpisodeFilm, film_frames
from readygo.apps.pictures.film import write_film
from readygo.common.arrays import UInt8Array
from readygo.common.drawing.plan_view import GOAL, HUMANS, ROBOT
from readygo.common.maps import GridFrame
from readygo.common.scenes.top_view import TopView

COUNT = 12


@pytest.fixture
def film() -> EpisodeFilm:
    grey = [np.full((36, 64, 3), 20 * k, np.uint8) for k in range(COUNT)]
    x = np.linspace(0.5, 3.0, COUNT)
    return EpisodeFilm(
        title="test",
        camera=grey,
        xyyaw=np.column_stack([x, np.full(COUNT, 1.5), np.zeros(COUNT)]),
        actions=np.tile([0.8, -0.3], (COUNT, 1)),
        goal_xy_m=np.array([3.5, 2.5]),
        humans_xy_m=(np.array([[3.0, 0.5], [2.9, 0.5], [2.8, 0.5]]),),
        outcome="success",
    )


@pytest.fixture
def top_view() -> TopView:
    frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.02)
    return TopView(rgb=np.full((150, 200, 3), 255, np.uint8), frame=frame)


def test_video_plays_back_with_all_images(film: EpisodeFilm, top_view: TopView, tmp_path: Path) -> None:
    out = tmp_path / "new" / "film.webm"
    write_film(out, film_frames(film, top_view))
    capture = cv2.VideoCapture(str(out))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(20.0)
    images = []
    while (read := capture.read())[0]:
        images.append(read[1])
    assert len(images) == COUNT
    # The camera's picture sits in the upper left corner and grows brighter.
    levels = [float(image[20:90, 20:150].mean()) for image in images]
    np.testing.assert_allclose(levels, np.arange(COUNT) * 20, atol=8)
    assert [path.name for path in out.parent.iterdir()] == ["film.webm"]


def test_plan_shows_robot_and_human_where_they_are(film: EpisodeFilm, top_view: TopView) -> None:
    pictures = list(film_frames(film, top_view, camera_height_px=110))
    left, height_px = 8 + 64 * 3 + 8, 36 * 3
    metre_px = height_px / 3.0
    for row, picture in ((0, pictures[0]), (COUNT - 1, pictures[-1])):
        x, y = film.xyyaw[row, :2]
        u, v = left + x * metre_px, 8 + height_px - y * metre_px
        assert tuple(picture[int(v) + 3, int(u) - 3]) == ROBOT
        human = film.humans_xy_m[0][min(row, 2)]
        u, v = left + human[0] * metre_px, 8 + height_px - human[1] * metre_px
        assert tuple(picture[int(v), int(u)]) == HUMANS[0]


def test_pictures_have_even_sides(top_view: TopView) -> None:
    odd = EpisodeFilm(
        title="",
        camera=[np.zeros((35, 63, 3), np.uint8)],
        xyyaw=np.zeros((1, 3)),
        actions=np.zeros((1, 2)),
        goal_xy_m=np.ones(2),
    )
    picture = next(film_frames(odd, top_view, camera_height_px=1))
    assert picture.shape[0] % 2 == 0
    assert picture.shape[1] % 2 == 0


def test_rows_that_do_not_match_are_refused(film: EpisodeFilm, top_view: TopView) -> None:
    with pytest.raises(ValueError, match="with one T"):
        EpisodeFilm(title="", xyyaw=film.xyyaw[1:], actions=film.actions, goal_xy_m=film.goal_xy_m)
    with pytest.raises(ValueError, match="at least one row"):
        EpisodeFilm(title="", xyyaw=np.zeros((0, 3)), actions=np.zeros((0, 2)), goal_xy_m=np.zeros(2))
    short = dataclasses.replace(film, camera=list(film.camera or ())[1:])
    with pytest.raises(ValueError, match="11 images for 12 rows"):
        list(film_frames(short, top_view))


def test_film_without_a_camera_shows_the_scene_alone(film: EpisodeFilm, top_view: TopView) -> None:
    picture = next(film_frames(dataclasses.replace(film, camera=None), top_view))
    metre_px = 640 / 3.0
    u, v = 8 + 0.5 * metre_px, 8 + 640 - 1.5 * metre_px
    assert tuple(picture[int(v) + 3, int(u) - 3]) == ROBOT
    assert picture.shape[1] >= 860


def test_underlay_is_drawn_below_humans(film: EpisodeFilm, top_view: TopView) -> None:
    drawn = []

    def paint(picture: np.ndarray, view: TopView, row: int) -> None:
        picture[:] = GOAL
        drawn.append(row)

    picture, *_ = film_frames(dataclasses.replace(film, underlay=paint), top_view, camera_height_px=110, step=5)
    left, height_px = 8 + 64 * 3 + 8, 36 * 3
    assert drawn == [0, 5, 10]
    assert tuple(picture[10, left + 3]) == GOAL
    u, v = left + 3.0 * height_px / 3.0, 8 + height_px - 0.5 * height_px / 3.0
    assert tuple(picture[int(v), int(u)]) == HUMANS[0]


def test_time_line_marks_when_a_human_is_seen(film: EpisodeFilm, top_view: TopView) -> None:
    seen = np.arange(COUNT) < COUNT // 2
    picture = list(film_frames(dataclasses.replace(film, human_visible=seen), top_view, camera_height_px=110))[-1]
    line = picture[36 * 3 + 16 + 56 + 5]
    warm = np.flatnonzero((line == HUMANS[2]).all(axis=1))
    assert warm.max() == pytest.approx(picture.shape[1] // 2, abs=8)
    assert warm.min() < 20


def test_film_looks_as_it_did(top_view: TopView, golden_image: Callable[[str, UInt8Array], None]) -> None:
    rng, count = np.random.default_rng(3), 25
    yaw = np.linspace(2.5, 3.4, count)
    crooked = EpisodeFilm(
        title="train-3-000017",
        camera=list(rng.integers(0, 255, (count, 6, 10, 3)).astype(np.uint8)),
        xyyaw=np.column_stack([np.linspace(3.1, 1.2, count), np.linspace(0.6, 1.9, count), yaw]),
        actions=np.column_stack([np.linspace(0.2, 1.3, count), np.linspace(0.9, -0.4, count)]),
        goal_xy_m=np.array([0.7, 2.2]),
        humans_xy_m=(np.linspace((0.4, 0.4), (1.4, 0.7), 12), np.linspace((3.6, 2.7), (2.2, 2.5), count)),
        human_visible=np.isin(np.arange(count), [3, 4, 5, 11, 24]),
        replanned=np.isin(np.arange(count), [0, 9, 17]),
        outcome="human collision",
        robot_radius_m=0.31,
        human_radius_m=0.17,
        success_radius_m=0.4,
        rate_hz=10,
        v_max_mps=1.5,
        w_max_radps=1.1,
    )
    frames = list(film_frames(crooked, top_view, camera_height_px=100, step=4))
    plain = dataclasses.replace(crooked, enlarged=False, camera=list(crooked.camera or ()), outcome="success")
    high = list(film_frames(dataclasses.replace(plain, rate_hz=13), top_view, camera_height_px=90, step=6))
    golden_image("episode_film", np.concatenate([frames[1], frames[3], frames[4], high[4]]))


def test_outcome_stands_in_the_last_second(film: EpisodeFilm, top_view: TopView) -> None:
    def pictures(outcome: str) -> list[UInt8Array]:
        told = dataclasses.replace(film, outcome=outcome, rate_hz=5)
        return list(film_frames(told, top_view, camera_height_px=36))

    changed = [bool((a != b).any()) for a, b in zip(pictures(""), pictures("timeout"), strict=True)]
    assert changed == [row >= COUNT - 5 for row in range(COUNT)]
