import json
from pathlib import Path

import pytest

from readygo.common.dataset.aside import SET_ASIDE, read_set_aside, set_aside_lines
from readygo.common.dataset.validate import validate
from readygo.common.errors import DatasetError
from tests.common.dataset.episodes import write_shard


def test_folder_without_the_file_lacks_no_episode(tmp_path: Path) -> None:
    assert read_set_aside(tmp_path) == {}
    assert set_aside_lines(tmp_path) == []


def test_episodes_are_told_in_the_order_of_their_indices_and_by_validate(tmp_path: Path) -> None:
    write_shard(tmp_path, [0, 1])
    (tmp_path / SET_ASIDE).write_text(json.dumps({"12": "no floor", "7": "8 workers ended while they held it"}))
    assert read_set_aside(tmp_path) == {7: "8 workers ended while they held it", 12: "no floor"}
    report = validate(tmp_path)
    assert report.ok
    assert report.notes == (
        "Episode 7 was set aside, the next index took its place: 8 workers ended while they held it",
        "Episode 12 was set aside, the next index took its place: no floor",
    )


@pytest.mark.parametrize("text", ["", "[1]", '{"x": ""}', "[" * 100_000, "\udcff"])
def test_damaged_file_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / SET_ASIDE).write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(DatasetError, match=r"set_aside\.json is damaged"):
        read_set_aside(tmp_path)
