import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from readygo.apps.fleet.run import record
from readygo.apps.pictures.episode_film import film_frames
from readygo.apps.pictures.playback import recorded_film, rows_of
from readygo.apps.pictures.recorded import PAGE_WIDTH_PX, RecordedEpisodes
from readygo.common.dataset import Dataset
from readygo.common.episode import EpisodeConfig
from readygo.common.messages import Split
from readygo.common.robot import RobotConfig
from readygo.common.robot.clock import Clock
from readygo.common.scenes.top_view import top_view
from readygo.runs.config import RunConfig
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from tests.common.policy.artifacts import ROBOT


def record_with(robot: RobotConfig, episodes: int, out: Path) -> RecordedEpisodes:
    config = RunConfig(robot=robot, episode=EpisodeConfig(goal_distance_max_m=4.0))
    spec = make_spec(open_scene("embedded"), None, config, seed=1, split=Split.TRAIN, static=False)
    record(spec, out, episodes=episodes, workers=0)
    return RecordedEpisodes(Dataset(out), open_scene("embedded").maps.robot)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> RecordedEpisodes:
    return record_with(ROBOT, 2, tmp_path_factory.mktemp("recorded") / "data")


def test_humans_are_where_they_were_recorded(recorded: RecordedEpisodes) -> None:
    data = recorded.dataset
    for entry in data.episodes:
        humans, drawn = recorded.film(entry).humans_xy_m, recorded.draw_episode(entry)
        joints_m = data.joints_m(entry.first_sample)
        assert len(humans) == len(joints_m) > 0
        np.testing.assert_allclose([way[0] for way in humans], joints_m[:, 0, :2], atol=0.01)
        assert len(drawn.robot_xy_m) == entry.sample_count
        for way, shown in zip(humans, drawn.humans_xy_m, strict=True):
            assert (way[len(shown) :] == way[-1]).all(), "only what repeats the last point is not drawn"
            assert len(shown) == 1 or (shown[-2] != shown[-1]).any()


def test_film_has_a_picture_for_every_row(recorded: RecordedEpisodes, tmp_path: Path) -> None:
    entry, view = recorded.dataset.episodes[0], top_view(open_scene("embedded"))
    film = recorded.film(entry)
    assert (film.outcome, len(film.xyyaw)) == ("success", entry.sample_count)
    assert len(list(film_frames(film, view, step=20))) == -(-entry.sample_count // 20)
    recorded.write_film(tmp_path / "film.webm", entry, view)
    capture = cv2.VideoCapture(str(tmp_path / "film.webm"))
    count = 0
    while capture.read()[0]:
        count += 1
    step = max(2, -(-entry.sample_count // 120))
    assert count == -(-entry.sample_count // step) <= 120
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(10.0)


def test_films_show_all_cameras_side_by_side(tmp_path: Path) -> None:
    left = dataclasses.replace(ROBOT.camera, mount_yaw_deg=75.0)
    recorded = record_with(dataclasses.replace(ROBOT, cameras={"left": left}), 1, tmp_path / "data")
    entry, view = recorded.dataset.episodes[0], top_view(open_scene("embedded"))
    film = recorded.film(entry, width_px=PAGE_WIDTH_PX)
    together = next(iter(film.camera or ()))
    played = next(iter(recorded_film(recorded.dataset, 0, width_px=PAGE_WIDTH_PX).camera or ()))
    np.testing.assert_array_equal(together, played)
    recorded.write_film(tmp_path / "film.webm", entry, view)
    shown, first = cv2.VideoCapture(str(tmp_path / "film.webm")).read()
    assert shown
    corner = first[8 : 8 + len(together), 8 : 8 + together.shape[1], ::-1]
    assert np.abs(corner.astype(int) - together).mean() < 5


def test_best_encounter_shows_a_human_for_longest(recorded: RecordedEpisodes) -> None:
    entries = list(recorded.dataset.episodes)
    shown = [int(np.sum(recorded.nearness(entry) > -1.2)) for entry in entries]
    best = recorded.best_encounter(entries)
    assert shown[entries.index(best)] == max(shown)
    assert rows_of(best).stop - rows_of(best).start == best.sample_count


@pytest.mark.parametrize(("rate_hz", "step"), [(20, 2), (25, 3), (30, 3)])
def test_film_of_a_page_is_not_slower_than_the_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rate_hz: int, step: int
) -> None:
    steps: list[int] = []
    monkeypatch.setattr("readygo.apps.pictures.recorded.film_frames", lambda *_, step, **__: steps.append(step))
    monkeypatch.setattr("readygo.apps.pictures.recorded.write_film", lambda *_, **__: None)
    recorded: Any = SimpleNamespace(
        dataset=SimpleNamespace(clock=Clock(rate_hz=rate_hz)), film=lambda entry, width_px: None
    )
    entry: Any = SimpleNamespace(sample_count=100)
    RecordedEpisodes.write_film(recorded, tmp_path / "film.webm", entry, recorded)
    assert steps == [step]
