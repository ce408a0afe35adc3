"""`readygo avatar list` and `readygo avatar preview`: the avatars of pedestrians, as a table and as pictures."""

import json as json_module
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.table import Table
from tyro.conf import Positional

from readygo.apps.terminal import PlainConsole
from readygo.common.avatars import avatar_hash, avatar_paths, load_avatar
from readygo.common.avatars.file import EMBEDDED_FOLDER
from readygo.common.avatars.variants import write_variants
from readygo.common.errors import AvatarError


@dataclass(frozen=True, kw_only=True)
class AvatarListOptions:
    """List avatars with their heights, sizes and licenses; --json prints the full licenses."""

    avatars: Path | None = None
    """Avatar file or folder of avatars; the embedded ones by default."""
    json: bool = False
    """Print a JSON array."""


def avatar_list(options: AvatarListOptions) -> None:
    """List avatars with their heights, sizes and licenses; --json prints the full licenses."""
    rows = [_describe_avatar(path) for path in avatar_paths(options.avatars)]
    if options.json:
        sys.stdout.write(json_module.dumps(rows, indent=2) + "\n")
        return
    table = Table("name", "height [m]", "Gaussians", "size [MB]", "license")
    for row in rows:
        size_mb, license = row["size_bytes"] / 1e6, row["license"].split(". ")[0]
        table.add_row(row["name"], f"{row['height_m']:.2f}", f"{row['gaussians']:,}", f"{size_mb:.2f}", license)
    PlainConsole().print(table)


@dataclass(frozen=True, kw_only=True)
class AvatarPreviewOptions:
    """Draw an avatar from all sides, draw four phases of its gait, or write a video of it walking."""

    avatar: Positional[Path]
    """Avatar file, or the name of an embedded avatar."""
    out: Path | None = None
    """PNG to write: eight sides, standing and in mid-stride."""
    sheet: Path | None = None
    """PNG to write: a contact sheet of four phases of the gait, each from three sides."""
    video: Path | None = None
    """.webm (quick to write) or .mp4: the avatar walks an S-curve over a floor with lines every 0.5 m."""
    seed: int = 0
    """Seed of the gait's individual style."""


def avatar_preview(options: AvatarPreviewOptions) -> None:
    """Draw an avatar from all sides, draw four phases of its gait, or write a video of it walking."""
    if options.out is None and options.sheet is None and options.video is None:
        raise AvatarError("Say what to make: --out person.png, --sheet gait.png, --video person.webm, or several.")
    from readygo.apps.pictures.film import CODECS, write_film

    for option, path, endings in (
        ("--out", options.out, (".png",)),
        ("--sheet", options.sheet, (".png",)),
        ("--video", options.video, tuple(CODECS)),
    ):
        if path is not None and path.suffix.lower() not in endings:
            raise AvatarError(f"{option} {path} must end in {' or '.join(endings)}.")
    from readygo.common.drawing.files import write_png

    human = load_avatar(file_of_avatar(options.avatar))
    if options.out is not None:
        from readygo.apps.avatar.studio import standing_pose, stride_pose, turntable

        write_png(options.out, turntable(human, (standing_pose(), stride_pose())))
    if options.sheet is not None:
        from readygo.apps.avatar.walking import contact_sheet

        write_png(options.sheet, contact_sheet(human, seed=options.seed))
    if options.video is not None:
        from readygo.apps.avatar.walking import walk_frames

        write_film(options.video, walk_frames(human, seed=options.seed))


@dataclass(frozen=True, kw_only=True)
class AvatarVaryOptions:
    """Make more avatars from a few: other clothes, skin, hair, patterns and heights, for networks that see people."""

    avatars: Positional[Path | None] = None
    """Avatar file or folder of avatars; by default the embedded ones. The suffix ":train" or ":test", also after
    "embedded", selects one part."""
    out: Path
    """Folder for the avatars, new or empty."""
    count: int = 200
    """Number of avatars."""
    seed: int = 0
    """Seed of the changes."""


def avatar_vary(options: AvatarVaryOptions) -> None:
    """Make more avatars from a few: other clothes, skin, hair, patterns and heights, for networks that see people."""
    made = write_variants(options.avatars, options.out, options.count, options.seed)
    PlainConsole(soft_wrap=True).print(f"{len(made)} avatars in {options.out}.", markup=False)


def _describe_avatar(path: Path) -> dict[str, Any]:
    avatar = load_avatar(path)
    return {
        "name": avatar.name,
        "path": str(path),
        "height_m": avatar.height_m,
        "gaussians": len(avatar.cloud),
        "size_bytes": path.stat().st_size,
        "license": avatar.license,
        "hash": avatar_hash(avatar),
    }


def file_of_avatar(avatar: Path) -> Path:
    """The file of an avatar that is given as a path or by the name of an embedded one."""
    embedded = EMBEDDED_FOLDER / f"{avatar}.npz"
    if avatar.exists() or avatar.name != str(avatar) or not embedded.exists():
        return avatar
    return embedded
