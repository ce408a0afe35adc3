from pathlib import Path

import numpy as np
import pytest

from readygo.common.dataset import Dataset, recorded_clarity
from readygo.common.dataset.clarity import LOOKED_AT_MAX
from tests.common.dataset.episodes import write_shard


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    write_shard(tmp_path, [0, 1, 2])
    return Dataset([tmp_path])


def test_samples_are_spread_over_every_episode(dataset: Dataset) -> None:
    clarity = recorded_clarity(dataset)
    assert dataset.episode_of_sample[clarity.samples].tolist() == [0] * 5 + [1] * 5 + [2] * 5
    assert len(set(clarity.samples.tolist())) == 15
    assert clarity.of_episode.tolist() == np.median(clarity.sharpness.reshape(3, 5), axis=1).tolist()


def test_noise_is_sharp_and_one_colour_is_blurred(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    assert recorded_clarity(dataset).blurred == 0
    monkeypatch.setattr(Dataset, "decode", lambda self, index: np.full((24, 32, 3), 200, np.uint8))
    clarity = recorded_clarity(dataset)
    assert clarity.blurred == 3
    assert clarity.to_mapping()["episodes_blurred"] == 3
    assert "3 of 3 episodes blurred" in str(clarity)


def test_samples_without_a_picture_are_left_out(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    image = Dataset.image
    monkeypatch.setattr(Dataset, "image", lambda self, index: image(self, index) if index % 4 == 0 else b"")
    assert (recorded_clarity(dataset).samples % 4 == 0).all()


def test_long_runs_are_looked_at_here_and_there(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dataset, "episodes", dataset.episodes * 1000)
    assert len(recorded_clarity(dataset).samples) == LOOKED_AT_MAX
