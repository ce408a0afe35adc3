from pathlib import Path

import numpy as np
import pytest

from readygo.apps.pictures.episode_film import film_frames
from readygo.apps.pictures.playback import background, recorded_film
from readygo.common.dataset import Dataset
from readygo.common.errors import DatasetError
from tests.common.dataset.episodes import GOAL_XY_M, write_left_shard, write_shard


def test_film_is_what_was_recorded(tmp_path: Path) -> None:
    write_shard(tmp_path, [0, 1])
    dataset = Dataset([tmp_path])
    film = recorded_film(dataset, 1)
    entry = dataset.episodes[1]
    assert film.title == entry.episode.episode_id
    assert len(film.xyyaw) == entry.sample_count
    np.testing.assert_allclose(film.goal_xy_m, GOAL_XY_M, atol=1e-5)
    humans = dataset.humans_xyzyaw[entry.first_sample :][: entry.sample_count]
    for human, way in enumerate(film.humans_xy_m):
        np.testing.assert_array_equal(way, [row[human, :2] for row in humans])


def test_all_cameras_are_side_by_side_or_one_alone(tmp_path: Path) -> None:
    write_left_shard(tmp_path, [0])
    dataset = Dataset([tmp_path])
    view = background(dataset, 0, tmp_path)
    together = next(iter(recorded_film(dataset, 0).camera or ()))
    left = next(iter(recorded_film(dataset, 0, "left").camera or ()))
    front = next(iter(recorded_film(dataset, 0, "front").camera or ()))
    assert together.shape[0] > front.shape[0] // 2
    assert not np.array_equal(front, left)
    picture = next(film_frames(recorded_film(dataset, 0), view))
    np.testing.assert_array_equal(picture[8 : 8 + len(together), 8 : 8 + together.shape[1]], together)
    with pytest.raises(DatasetError, match="no images of a camera 'rear'; there are those of left, front"):
        recorded_film(dataset, 0, "rear")


def test_without_its_scene_the_ground_around_it_is_empty(tmp_path: Path) -> None:
    write_shard(tmp_path, [0])
    dataset = Dataset([tmp_path])
    view = background(dataset, 0, tmp_path)
    inside = view.world_to_pixel(np.vstack([recorded_film(dataset, 0).xyyaw[:, :2], GOAL_XY_M]))
    assert (inside >= 0).all()
    assert (inside < view.rgb.shape[1::-1]).all()
    assert len(np.unique(view.rgb)) == 1
