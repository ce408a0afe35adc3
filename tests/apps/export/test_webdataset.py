import json
import tarfile
from pathlib import Path

from readygo.apps.export import webdataset
from readygo.apps.export.source import Source
from tests.common.dataset.episodes import write_shard


def test_rows_follow_each_other_with_their_members_together(source: Source, tmp_path: Path) -> None:
    facts = [webdataset.write(source, part, tmp_path) for part in source.parts(10**9)]
    webdataset.finish(source, tmp_path, facts)
    index = json.loads((tmp_path / "index.json").read_text())
    assert [(file["file"], file["rows"]) for file in index["files"]] == [
        ("train-000000.tar", 31),
        ("val-000000.tar", 6),
    ]
    with tarfile.open(tmp_path / "train-000000.tar") as tar:
        names = tar.getnames()
        assert names[:2] == ["000000-train-7-000000-000000.jpg", "000000-train-7-000000-000000.json"]
        assert len(names) == 62
        row = json.load(tar.extractfile(names[5]))
        assert tar.extractfile(names[4]).read() == source.dataset.image(int(source.episode(0).samples[2]))
    assert (row["row"], row["outcome"]) == (2, "success")
    assert row["goal_xy_m"] == source.episode(0).columns["goal_xy_m"][2].tolist()


def test_further_images_lie_beside(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    folder.mkdir()
    write_shard(folder, [0], outputs=("depth", "mask"))
    source = Source([folder])
    webdataset.write(source, source.parts(10**9)[0], tmp_path)
    with tarfile.open(tmp_path / "train-000000.tar") as tar:
        assert [name.partition(".")[2] for name in tar.getnames()[:4]] == ["jpg", "depth.png", "mask.png", "json"]
