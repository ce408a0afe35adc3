"""The demo's film: it plays back, and shows what happened where."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from apps.demo.plan_view import HUMANS, ROBOT
from apps.demo.video import EpisodeFilm, film_frames, write_episode_animation, write_episode_video
from common.errors import ReadygoError
from common.maps import GridFrame
from common.scenes.top_view import TopView

COUNT = 12


@pytest.fixture
def film() -> EpisodeFilm:
    grey = [np.full((36, 64, 3), 20 * k, np.uint8) for k in range(COUNT)]
    x = np.linspace(0.5, 3.0, COUNT)
    return EpisodeFilm(
        title="test",
        rgb=grey,
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
    out = tmp_path / "new" / "film.mp4"
    write_episode_video(out, film, top_view)
    capture = cv2.VideoCapture(str(out))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(20.0)
    images = []
    while (read := capture.read())[0]:
        images.append(read[1])
    assert len(images) == COUNT
    # The camera's picture sits in the upper left corner and grows brighter.
    levels = [float(image[20:90, 20:150].mean()) for image in images]
    np.testing.assert_allclose(levels, np.arange(COUNT) * 20, atol=8)
    assert [path.name for path in out.parent.iterdir()] == ["film.mp4"]


def test_animation_plays_at_the_films_pace(film: EpisodeFilm, top_view: TopView, tmp_path: Path) -> None:
    out = tmp_path / "film.webp"
    write_episode_animation(out, film, top_view, step=2)
    done, animation = cv2.imreadanimation(str(out))
    assert done
    assert len(animation.frames) == COUNT // 2
    assert list(animation.durations)[:-1] == [100] * (COUNT // 2 - 1)


def test_plan_shows_robot_and_human_where_they_are(film: EpisodeFilm, top_view: TopView) -> None:
    pictures = list(film_frames(film, top_view, camera_scale=3))
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
        rgb=[np.zeros((35, 63, 3), np.uint8)],
        xyyaw=np.zeros((1, 3)),
        actions=np.zeros((1, 2)),
        goal_xy_m=np.ones(2),
    )
    picture = next(film_frames(odd, top_view, camera_scale=1))
    assert picture.shape[0] % 2 == 0
    assert picture.shape[1] % 2 == 0


def test_rows_that_do_not_match_are_refused(film: EpisodeFilm) -> None:
    with pytest.raises(ValueError, match="for 12 images"):
        EpisodeFilm(title="", rgb=film.rgb, xyyaw=film.xyyaw[1:], actions=film.actions, goal_xy_m=film.goal_xy_m)
    with pytest.raises(ValueError, match="at least one image"):
        EpisodeFilm(title="", rgb=[], xyyaw=np.zeros((0, 3)), actions=np.zeros((0, 2)), goal_xy_m=np.zeros(2))


def test_folder_that_cannot_be_made_is_reported(film: EpisodeFilm, top_view: TopView, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ReadygoError, match="cannot be written"):
        write_episode_video(tmp_path / "file" / "film.mp4", film, top_view)
