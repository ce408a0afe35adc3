from pathlib import Path

import cv2

from readygo.apps.commands.card import card
from readygo.common.dataset import Dataset


def test_folder_describes_itself_and_stays_a_dataset(data: Path) -> None:
    before = Dataset([data]).content_hash
    card(data)
    text = (data / "README.md").read_text()
    for picture in ("card/frames.jpg", "card/visits.png"):
        assert f"({picture})" in text
        assert cv2.imread(str(data / picture)) is not None
    assert Dataset([data]).content_hash == before
