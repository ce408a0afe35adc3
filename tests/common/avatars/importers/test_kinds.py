import os
import tracemalloc
import zipfile
from pathlib import Path

import pytest

from readygo.common.avatars.file import EMBEDDED_FOLDER
from readygo.common.avatars.importers import FileKind, kind_of
from readygo.common.errors import AvatarError
from tests.common.avatars.importers.humans import write_glb, write_smpl_npz, write_smpl_pickle


def test_kinds_are_told_apart_by_content_and_not_by_name(tmp_path: Path, bound: tuple[Path, Path]) -> None:
    (tmp_path / "a.bin").write_bytes(write_glb(tmp_path / "p.glb").read_bytes())
    (tmp_path / "b.bin").write_bytes(write_smpl_npz(tmp_path / "p.npz").read_bytes())
    (tmp_path / "c.bin").write_bytes(bound[0].read_bytes())
    (tmp_path / "d.bin").write_bytes(write_smpl_pickle(tmp_path / "p.pkl").read_bytes())
    assert [kind_of(tmp_path / f"{name}.bin") for name in "abcd"] == [
        FileKind.GLTF,
        FileKind.SMPL,
        FileKind.GAUSSIANS,
        FileKind.SMPL,
    ]


@pytest.mark.parametrize("data", [b"", b"hello", b"PK\x03\x04 broken", b"{}", b"\x89PNG"])
def test_foreign_files_are_refused_in_one_line(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x").write_bytes(data)
    with pytest.raises(AvatarError) as raised:
        kind_of(tmp_path / "x")
    assert "\n" not in str(raised.value)


def test_avatar_files_need_no_import() -> None:
    with pytest.raises(AvatarError, match="avatar file already"):
        kind_of(sorted(EMBEDDED_FOLDER.glob("*.npz"))[0])


def test_archives_with_much_in_them_cost_little(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("format.npy", bytes(2**26))
    tracemalloc.start()
    with pytest.raises(AvatarError, match="neither a HUGS checkpoint nor a SMPL model"):
        kind_of(tmp_path / "a.npz")
    assert tracemalloc.get_traced_memory()[1] < 2**22
    tracemalloc.stop()
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="a pipe or a device"):
        kind_of(tmp_path / "pipe")
    (tmp_path / "deep").write_bytes(b'{"a":' + b"[" * 100_000)
    with pytest.raises(AvatarError, match="no human that can be imported"):
        kind_of(tmp_path / "deep")
