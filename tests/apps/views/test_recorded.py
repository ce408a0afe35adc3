import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.views.pictures import sharpness_colour
from readygo.apps.views.recorded import recorded_map, run_clarity, thumbnails
from readygo.common.dataset import Dataset, recorded_clarity
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages import Split
from readygo.runs.config import RunConfig
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from tests.common.dataset.episodes import write_shard


@pytest.fixture
def data(tmp_path: Path) -> Path:
    write_shard(tmp_path, [0, 1, 2])
    return tmp_path


def fog(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Dataset, "decode", lambda self, index: np.full((24, 32, 3), 200, np.uint8))


def test_thumbnails_come_in_rows_of_six(data: Path) -> None:
    picture = thumbnails(Dataset([data]), "plaza")
    assert picture.shape[1] > 6 * 256
    # Fifteen are three rows of 192 px and their captions.
    assert 3 * 212 < picture.shape[0] < 3 * 212 + 120


def test_the_map_is_drawn_with_and_without_one(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fog(monkeypatch)
    dataset = Dataset([data])
    frame = GridFrame(origin_x_m=-1.0, origin_y_m=-1.0, resolution_m=0.5)
    ground = OccupancyMap(frame=frame, occupied=np.zeros((8, 8), np.bool_))
    for occupancy in (None, ground):
        picture = recorded_map(dataset, recorded_clarity(dataset), occupancy)
        assert (picture == np.array(sharpness_colour(0.0), np.uint8)).all(axis=-1).any()


def test_warnings_name_blurred_episodes_and_where_they_are(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = make_spec(open_scene("embedded"), None, RunConfig(), seed=7, split=Split.TRAIN, static=True)
    clear = run_clarity(spec, data)
    assert clear.coverage is not None
    assert clear.recorded.blurred == 0
    fog(monkeypatch)
    blurred = run_clarity(dataclasses.replace(spec, scene_path="/nowhere"), data)
    assert blurred.coverage is None
    assert blurred.to_mapping()["coverage_median"] is None
    (warning,) = blurred.warnings()
    assert "3 of 3 episodes blurred" in warning
    assert "train-7-000001 near (" in warning


def test_little_surface_is_a_warning_too(data: Path) -> None:
    spec = make_spec(open_scene("embedded"), None, RunConfig(), seed=7, split=Split.TRAIN, static=True)
    (warning,) = dataclasses.replace(run_clarity(spec, data), coverage=0.2).warnings()
    assert "Only 20 % of the view is surface" in warning
