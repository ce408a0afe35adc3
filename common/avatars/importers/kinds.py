"""What a file is, by its content."""

import enum
import zipfile
from pathlib import Path

from readygo.common.avatars.file import FORMAT
from readygo.common.avatars.importers.gltf_file import GLB_MAGIC, GLTF_BYTES_MAX
from readygo.common.documents import read_json
from readygo.common.errors import AvatarError
from readygo.common.files import open_regular, open_zip

_FORMAT_BYTES = 4096
"""The format stands in the first bytes of its entry."""


class FileKind(enum.Enum):
    """Humans that can be imported."""

    HUGS = "HUGS checkpoint"
    SMPL = "SMPL model"
    GLTF = "glTF figure"
    GAUSSIANS = "3DGS .ply with weights"


def kind_of(path: Path) -> FileKind:
    """Find out what a file is.

    Raises:
        AvatarError: If it is none of the kinds that can be imported.
    """
    with open_regular(path) as stream:
        start = stream.read(64)
    if start[:4] == GLB_MAGIC:
        return FileKind.GLTF
    if start[:3] == b"ply":
        return FileKind.GAUSSIANS
    if start[:2] == b"PK":
        return _kind_of_archive(path)
    if start.lstrip()[:1] == b"{" and _is_gltf_json(path):
        return FileKind.GLTF
    # Pickles of protocol 2 and later begin with \\x80; SMPL's old ones are text of protocol 0.
    if start[:1] == b"\x80" or start[:1] == b"(":
        return FileKind.HUGS if path.suffix.lower() in (".pth", ".pt") else FileKind.SMPL
    raise AvatarError(
        f"{path} is no human that can be imported; give a HUGS checkpoint (.pth), a SMPL model (.pkl, .npz), a "
        "skinned glTF figure (.glb, .gltf, .vrm), or a 3DGS .ply with --weights."
    )


def _kind_of_archive(path: Path) -> FileKind:
    try:
        with open_zip(path) as archive:
            names = archive.namelist()
            is_avatar = "format.npy" in names and FORMAT.encode("utf-32-le") in _beginning(archive, "format.npy")
    except Exception as error:  # a damaged archive raises almost anything
        line = " ".join(str(error).split())[:300]
        raise AvatarError(f"{path} is a damaged archive: {line or type(error).__name__}") from error
    if is_avatar:
        raise AvatarError(f"{path} is an avatar file already; use it as it is.")
    if any(name.endswith("data.pkl") for name in names):
        return FileKind.HUGS
    if "v_template.npy" in names or "weights.npy" in names:
        return FileKind.SMPL
    some = ", ".join(names[:6])[:300]
    raise AvatarError(f"{path} is an archive of {some!r}: neither a HUGS checkpoint nor a SMPL model.")


def _beginning(archive: zipfile.ZipFile, name: str) -> bytes:
    with archive.open(name) as stream:
        return stream.read(_FORMAT_BYTES)


def _is_gltf_json(path: Path) -> bool:
    try:
        return "asset" in read_json(path, bytes_max=GLTF_BYTES_MAX)
    except ValueError:
        return False
