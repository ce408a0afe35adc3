from pathlib import Path

import numpy as np
import pytest

from readygo.apps.export.source import ExportSource
from readygo.common.errors import ConfigError
from readygo.common.messages import Split
from tests.crooked import ODD_RATES, crooked_episode


def test_training_comes_first_and_every_row_has_a_number(source: ExportSource) -> None:
    assert [len(source.episode(number)) for number in range(source.episode_count)] == [21, 10, 6]
    assert [source.episode(number).first_row for number in range(3)] == [0, 21, 31]
    assert (source.row_count, source.rate_hz) == (37, 20)
    assert source.of_split(Split.VAL) == range(2, 3)
    assert source.of_split(Split.TEST) == range(0)


def test_parts_hold_one_split_each_and_about_as_much_as_asked(source: ExportSource) -> None:
    def spread(size_bytes: int) -> list[tuple[str, int, range]]:
        return [(part.split.value, part.number_in_split, part.episodes) for part in source.parts(size_bytes)]

    assert spread(10**9) == [("train", 0, range(0, 2)), ("val", 0, range(2, 3))]
    assert spread(1) == [("train", 0, range(0, 1)), ("train", 1, range(1, 2)), ("val", 0, range(2, 3))]


def test_at_a_lower_rate_a_rows_action_is_the_mean_until_the_next(data: Path) -> None:
    source = ExportSource([data], 5)
    episode = source.episode(0)
    actions = source.dataset.actions[episode.entry.first_sample :][:21]
    assert len(episode) == 6
    np.testing.assert_allclose(episode.columns["action"][1], actions[4:8].mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(episode.columns["action"][-1], actions[20], rtol=1e-6)
    np.testing.assert_array_equal(episode.columns["velocity"][2], episode.columns["action"][1])
    assert episode.columns["velocity"][0].tolist() == [0.0, 0.0]
    assert episode.columns["is_last"].tolist() == [False] * 5 + [True]


def test_images_are_the_recorded_bytes(source: ExportSource) -> None:
    episode = source.episode(2)
    assert list(episode.images()) == [source.dataset.image(int(sample)) for sample in episode.samples]


@pytest.mark.parametrize("rate_hz", [3, 40, 0])
def test_rate_without_an_image_at_every_row_is_refused(data: Path, rate_hz: int) -> None:
    with pytest.raises(ConfigError, match="possible are 20, 10, 5, 4, 2, 1"):
        ExportSource([data], rate_hz)


def test_numbers_of_the_rows_are_those_of_the_samples_with_images(crooked_source: ExportSource) -> None:
    assert (crooked_source.rate_hz, crooked_source.stride) == (15, 2)
    first, second = (crooked_source.episode(number) for number in range(2))
    assert (len(first), first.first_row, len(second), second.first_row) == (6, 0, 9, 6)
    assert second.name == "000001-train-7-000008"
    assert (first.facts["outcome"], second.facts["outcome"]) == ("human_collision", "timeout")
    assert first.facts["policy"] == "5a" * 32
    _, samples = crooked_episode(8, 17, robot=ODD_RATES)
    rows = samples[::2]
    for name, values in (
        ("time_s", [row.seq / 30 for row in rows]),
        ("goal_xy_m", [row.goal_xy_robot_m for row in rows]),
        ("pose", [row.robot_xyzyaw for row in rows]),
        ("human_distance_m", [row.human_distance_m for row in rows]),
        ("time_to_collision_s", [row.time_to_collision_s for row in rows]),
        ("human_visible", [row.human_visible for row in rows]),
        ("replanned", [row.replanned for row in rows]),
    ):
        np.testing.assert_allclose(second.columns[name], values, atol=1e-6, err_msg=name)
    # The last row's command lasts for a single step: the episode has an odd number of them.
    np.testing.assert_allclose(second.columns["action"][-1], (samples[16].action_v_mps, samples[16].action_w_radps))
    assert list(second.images()) == [row.image for row in rows]
    assert list(second.images("left.depth")) == [row.outputs["left.depth"] for row in rows]


def test_parts_are_filled_up_to_their_size_and_not_beyond(source: ExportSource) -> None:
    sizes = [sum(map(len, source.episode(number).images())) for number in range(2)]
    assert source.parts(sum(sizes))[0].episodes == range(0, 2)
    assert [part.episodes for part in source.parts(sum(sizes) - 1)][:2] == [range(0, 1), range(1, 2)]
    assert [part.number for part in source.parts(1)] == [0, 1, 2]


def test_labels_of_the_expert_are_columns_where_the_data_holds_them(
    crooked_source: ExportSource, source: ExportSource
) -> None:
    episode = crooked_source.episode(1)
    _, samples = crooked_episode(8, 17, robot=ODD_RATES)
    labels = [sample.expert_commands[0] for sample in samples[::2]]
    np.testing.assert_allclose(episode.columns["expert_action"], labels, rtol=1e-6)
    assert not np.allclose(episode.columns["expert_action"], episode.columns["action"])
    assert "expert_action" not in source.episode(0).columns


def test_label_of_the_expert_at_a_lower_rate_is_the_mean_of_those_that_there_are(crooked_source: ExportSource) -> None:
    slow = ExportSource(crooked_source.folders, 5)
    labels = crooked_source.episode(1).columns["expert_action"]
    expected = [labels[first : first + 3].mean(axis=0) for first in range(0, len(labels), 3)]
    np.testing.assert_allclose(slow.episode(1).columns["expert_action"], expected, rtol=1e-5)
