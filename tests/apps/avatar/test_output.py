"""Avatars are not written over what they are made from, nor over files of something else."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.avatar.output import check_avatar_out
from readygo.common.avatars.file import EMBEDDED_FOLDER
from readygo.common.errors import AvatarError


def test_new_files_and_earlier_avatars_may_be_written(tmp_path: Path) -> None:
    (tmp_path / "film").mkdir()
    shutil.copy(EMBEDDED_FOLDER / "hana.npz", tmp_path / "old.npz")
    for name in ("new.npz", "old.npz", "film.npz"):
        check_avatar_out(tmp_path / name, [tmp_path / "film", None], [tmp_path / "new.pth", None])


def test_inputs_are_not_overwritten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    film = tmp_path / "film"
    film.mkdir()
    np.savez(film / "poses.npz", root_m=np.zeros(3))
    np.savez(tmp_path / "smpl.npz", shapedirs=np.zeros(3))
    (tmp_path / "link").symlink_to(film)
    for out in (film / "poses.npz", film / "deep" / "new.npz", Path("link/new.npz")):
        with pytest.raises(AvatarError, match="lies inside the input"):
            check_avatar_out(out, [film])
    with pytest.raises(AvatarError, match=r"smpl\.npz is an input"):
        check_avatar_out(Path("smpl.npz"), [film, tmp_path / "smpl.npz"])
    with pytest.raises(AvatarError, match=r"seg\.onnx is an input"):
        check_avatar_out(Path("new.npz"), [Path("seg.onnx")], [tmp_path / "seg.onnx"])
    with pytest.raises(AvatarError, match=r"smpl\.npz is there already and is no avatar"):
        check_avatar_out(Path("smpl.npz"), [film])
    with pytest.raises(AvatarError, match=r"must end in \.npz"):
        check_avatar_out(Path("new.ply"), [])
