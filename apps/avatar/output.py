"""Where an avatar may be written: not over the files that it is made from."""

from collections.abc import Iterable
from pathlib import Path

from readygo.common.avatars import load_avatar
from readygo.common.errors import AvatarError


def check_avatar_out(out: Path, inputs: Iterable[Path | None], others: Iterable[Path | None] = ()) -> None:
    """Check the name of an avatar file before the work begins.

    Args:
        out: The avatar file.
        inputs: Files and folders that it is made from; None stands for one that is not given.
        others: Further files that are written; None stands for one that is not written.

    Raises:
        AvatarError: If `out` does not end in .npz, is an .npz of something else, or if it or another output is an input
            or lies inside one.
    """
    if out.suffix.lower() != ".npz":
        raise AvatarError(f"--out {out} must end in .npz.")
    given = [path for path in inputs if path is not None]
    for written in (out, *(path for path in others if path is not None)):
        for source in given:
            _refuse_input(written, source)
    if out.exists():
        try:
            load_avatar(out)
        except AvatarError as error:
            raise AvatarError(f"{out} is there already and is no avatar; choose another --out.") from error


def _refuse_input(written: Path, source: Path) -> None:
    place, origin = written.resolve(), source.resolve()
    if place == origin:
        raise AvatarError(f"{written} is an input: it would be overwritten; choose another name.")
    if origin.is_dir() and origin in place.parents:
        raise AvatarError(f"{written} lies inside the input {source}; choose a place outside of it.")
