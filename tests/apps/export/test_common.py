import json
from pathlib import Path

from readygo.apps.export.common import described, suffix, write_json_lines
from readygo.apps.export.source import Source
from tests.common.dataset.episodes import jpeg


def test_ending_follows_from_the_bytes() -> None:
    assert suffix(jpeg(0)) == "jpg"
    assert suffix(b"\x89PNG\r\n") == "png"


def test_lines_are_json(tmp_path: Path, source: Source) -> None:
    write_json_lines(tmp_path / "a.jsonl", [described(source.episode(number), file=str(number)) for number in (0, 2)])
    rows = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert [row["name"] for row in rows] == ["000000-train-7-000000", "000002-val-7-000004"]
    assert rows[1]["rows"] == 6
    assert rows[1]["file"] == "2"
