from pathlib import Path

import cv2

from readygo.apps.commands.card import CardOptions, card
from readygo.common.dataset import Dataset
from tests.common.dataset.episodes import write_left_shard


def test_folder_describes_itself_and_stays_a_dataset(data: Path) -> None:
    before = Dataset([data]).content_hash
    card(CardOptions(data=data))
    text = (data / "README.md").read_text()
    for picture in ("card/frames.jpg", "card/visits.png"):
        assert f"({picture})" in text
        assert cv2.imread(str(data / picture)) is not None
    assert Dataset([data]).content_hash == before
    assert not (data / "card" / "cameras.jpg").exists(), "there is one image at a time"


def test_every_camera_has_its_picture(tmp_path: Path) -> None:
    write_left_shard(tmp_path, [0, 1])
    card(CardOptions(data=tmp_path))
    text = (tmp_path / "README.md").read_text()
    assert "(card/cameras.jpg)" in text
    assert cv2.imread(str(tmp_path / "card" / "cameras.jpg")) is not None
    assert "front 24x32, left 16x20" in text
    assert "camera left at 0.5 m with 100 deg that looks 90 deg to the left" in text
    assert 'data.decode_output(0, "left.depth")' in text
