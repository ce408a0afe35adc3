"""The page of an extracted avatar says what was measured and what was not seen."""

import numpy as np
import pytest

from readygo.apps.avatar import extracted
from readygo.apps.avatar.extracted import comparison, extraction_page, notes_of
from readygo.common.arrays import UInt8Array
from readygo.common.avatars import load_avatars
from readygo.services.reconstructor import Extraction, HeldOutPerson


def _extraction() -> Extraction:
    photo = np.full((3, 6, 4), 0.5, np.float32)
    held = HeldOutPerson(image="00008.png", psnr_db=27.25, ssim=0.912, photo=photo, rendered=photo + np.float32(0.1))
    report = {
        "psnr_db": 27.25, "ssim": 0.912, "gaussians": 44509, "height_m": 1.66, "body": "amara", "overlap": 0.81,
        "unseen": {"head": 0.02, "hands": 0.4}, "frames": 90, "steps": 100, "seconds": 60.0,
        "notes": ["the person is cut off."], "settings": {},
    }  # fmt: skip
    return Extraction(
        avatar=load_avatars()["amara"],
        held_out=[held],
        pose_axis_angle=np.zeros((1, 24, 3)),
        root_m=np.zeros((1, 3)),
        joints_m=np.zeros((1, 24, 3)),
        report=report,
    )


def test_page_names_quality_and_hidden_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    def blank(*_: object, **__: object) -> UInt8Array:
        return np.zeros((4, 4, 3), np.uint8)

    for sheet in ("motion_sheet", "contact_sheet", "turntable"):
        monkeypatch.setattr(extracted, sheet, blank)
    text = extraction_page(_extraction())
    for words in (
        "27.2 dB",
        "SSIM 0.912",
        "00008.png",
        "44,509",
        "40 %",
        "the person is cut off.",
        "a turn, and a run",
    ):
        assert words in text


def test_notes_name_parts_that_are_mostly_hidden() -> None:
    notes = notes_of(_extraction().report)
    assert notes == ["the person is cut off.", "no frame shows all of hands (40%); record from all sides."]


def test_comparison_has_film_avatar_and_difference() -> None:
    picture = comparison(_extraction().held_out[0])
    assert picture.shape == (6, 12, 3)
    assert picture[0, 0, 0] == 128
    assert picture[0, 4, 0] == 153
    assert picture[0, 8, 0] == pytest.approx(102, abs=1)
