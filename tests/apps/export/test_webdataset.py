import json
import tarfile
from pathlib import Path

from readygo.apps.export import webdataset
from readygo.apps.export.source import ExportSource
from tests.common.dataset.episodes import write_shard
from tests.crooked import ODD_RATES, crooked_episode


def test_rows_follow_each_other_with_their_members_together(source: ExportSource, tmp_path: Path) -> None:
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
    source = ExportSource([folder])
    webdataset.write(source, source.parts(10**9)[0], tmp_path)
    with tarfile.open(tmp_path / "train-000000.tar") as tar:
        assert [name.partition(".")[2] for name in tar.getnames()[:4]] == ["jpg", "depth.png", "mask.png", "json"]


def test_numbers_that_are_infinite_are_null_and_others_stay(source: ExportSource, tmp_path: Path) -> None:
    webdataset.write(source, source.parts(10**9)[0], tmp_path)
    with tarfile.open(tmp_path / "train-000000.tar") as tar:
        row = json.load(tar.extractfile("000001-train-7-000002-000003.json"))
    columns = source.episode(1).columns
    assert row["time_to_collision_s"] is None
    assert row["human_distance_m"] == float(columns["human_distance_m"][3])
    assert row["action"] == columns["action"][3].tolist()
    assert (row["row"], row["is_last"], row["replanned"]) == (3, False, True)


def test_depths_of_all_cameras_lie_beside_at_every_row_with_an_image(
    crooked_source: ExportSource, tmp_path: Path
) -> None:
    facts = webdataset.write(crooked_source, crooked_source.parts(10**9)[0], tmp_path)
    assert facts["rows"] == 15
    _, samples = crooked_episode(8, 17, robot=ODD_RATES)
    with tarfile.open(tmp_path / "train-000000.tar") as tar:
        stem = "000001-train-7-000008-000004"
        endings = ("jpg", "depth.png", "left.rgb.jpg", "left.depth.png")
        found = [tar.extractfile(f"{stem}.{ending}").read() for ending in endings]
    outputs = samples[8].outputs
    assert found == [samples[8].image, outputs["depth"], outputs["left.rgb"], outputs["left.depth"]]
