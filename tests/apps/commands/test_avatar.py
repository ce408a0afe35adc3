import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.apps.avatar.walking import TILE
from readygo.apps.commands.avatar import AvatarListOptions, AvatarPreviewOptions, avatar_list, avatar_preview
from readygo.common.avatars import load_avatars
from readygo.common.errors import AvatarError


def test_list_as_json_describes_every_embedded_avatar(capsys: pytest.CaptureFixture[str]) -> None:
    avatar_list(AvatarListOptions(json=True))
    rows = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in rows] == list(load_avatars())
    assert all(row["size_bytes"] < 1_500_000 and row["gaussians"] > 0 and len(row["hash"]) == 64 for row in rows)
    assert all("CC0" in row["license"] for row in rows)


def test_list_prints_names_and_heights(capsys: pytest.CaptureFixture[str]) -> None:
    avatar_list(AvatarListOptions())
    printed = capsys.readouterr().out
    assert all(name in printed and f"{avatar.height_m:.2f}" in printed for name, avatar in load_avatars().items())


def test_list_of_a_folder_without_avatars_says_so(tmp_path: Path) -> None:
    with pytest.raises(AvatarError, match="no avatar"):
        avatar_list(AvatarListOptions(avatars=tmp_path))


def test_preview_shows_the_human_from_all_sides(tmp_path: Path) -> None:
    name = next(iter(load_avatars()))
    avatar_preview(AvatarPreviewOptions(avatar=Path(name), out=tmp_path / "sheet.png"))
    sheet = cv2.imread(str(tmp_path / "sheet.png")).astype(int)
    height, width = sheet.shape[0] // 2, sheet.shape[1] // 8
    for row in range(2):
        for column in range(8):
            tile = sheet[row * height : (row + 1) * height, column * width : (column + 1) * width]
            # Wall and floor are grey and light.
            person = (np.ptp(tile, axis=2) > 30) | (tile.max(axis=2) < 70)
            assert 0.05 < person.mean() < 0.5
            assert not person[:4].any()
            assert not person[-4:].any()
    assert [path.name for path in tmp_path.iterdir()] == ["sheet.png"]


def test_contact_sheet_shows_four_phases_from_three_sides(tmp_path: Path) -> None:
    avatar_preview(AvatarPreviewOptions(avatar=Path("bruno"), sheet=tmp_path / "gait.png"))
    sheet = cv2.imread(str(tmp_path / "gait.png")).astype(int)
    assert sheet.shape == (3 * TILE.height_px, 4 * TILE.width_px, 3)
    tiles = sheet.reshape(3, TILE.height_px, 4, TILE.width_px, 3).swapaxes(1, 2)
    people = (np.ptp(tiles, axis=-1) > 30) | (tiles.max(axis=-1) < 70)
    # Below the caption.
    people[:, :, :40] = False
    assert (people.mean(axis=(2, 3)) > 0.08).all()
    assert not people[:, :, -4:].any()
    low = [np.ptp(np.flatnonzero(tile[335:].any(axis=0))) for tile in people[1]]
    assert min(low[0], low[2]) > 1.15 * max(low[1], low[3])


def test_preview_asks_what_to_make(tmp_path: Path) -> None:
    with pytest.raises(AvatarError, match="--video"):
        avatar_preview(AvatarPreviewOptions(avatar=Path("amara")))
    with pytest.raises(AvatarError, match=r"--sheet gait.jpg must end in \.png"):
        avatar_preview(AvatarPreviewOptions(avatar=Path("amara"), sheet=Path("gait.jpg")))
    with pytest.raises(AvatarError, match=r"\.mp4"):
        avatar_preview(AvatarPreviewOptions(avatar=Path("amara"), video=tmp_path / "film.avi"))


def test_preview_refuses_other_formats_and_missing_files(tmp_path: Path) -> None:
    with pytest.raises(AvatarError, match=r"\.png"):
        avatar_preview(AvatarPreviewOptions(avatar=Path("amara"), out=tmp_path / "sheet.jpg"))
    with pytest.raises(AvatarError, match="cannot be read"):
        avatar_preview(AvatarPreviewOptions(avatar=Path("nobody"), out=tmp_path / "sheet.png"))
