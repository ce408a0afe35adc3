"""Who walks in data and who is kept for tests: `FOLDER:train` and `FOLDER:test` name two disjoint parts of avatars."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from readygo.common.avatars.avatar import Avatar
from readygo.common.avatars.file import avatar_paths, load_avatars
from readygo.common.errors import AvatarError

TRAIN, TEST = "train", "test"
EMBEDDED = "embedded"
"""Stands for the embedded avatars before a colon."""
TRAIN_MIN, TEST_MIN = 6, 2
"""With fewer avatars, unseen people say nothing."""
TEST_SHARE = 4
"""One avatar of so many is kept for tests."""

Value = TypeVar("Value")


def split_cast(path: Path | None) -> tuple[Path | None, str]:
    """A place of avatars without its cast, and the cast: "train", "test", or "" for all of them.

    Args:
        path: As a user names it: a file, a folder, or one of them, or `embedded`, with `:train` or `:test` behind it.
    """
    if path is None or path.exists():
        return path, ""
    place, _, cast = str(path).rpartition(":")
    if cast not in (TRAIN, TEST):
        return path, ""
    return None if place == EMBEDDED else Path(place), cast


def load_cast(path: Path | None) -> dict[str, Avatar]:
    """The avatars of a place or of a cast of it, by name; see `split_cast`.

    Raises:
        AvatarError: If there is none, one cannot be read, or they are too few to be split.
    """
    place, cast = split_cast(path)
    return members(load_avatars(place), cast)


def with_cast(place: Path | None, cast: str) -> Path:
    """The name of a cast, see `split_cast`."""
    return Path(f"{place or EMBEDDED}:{cast}")


def learned_and_tested(path: Path | None) -> tuple[Path | None, Path | None]:
    """Whom to learn among, and whom to test among: the casts of a place of avatars.

    Both are the place itself where it names a cast already, or has too few avatars to be split.

    Args:
        path: As for `split_cast`.

    Raises:
        AvatarError: If there is no avatar.
    """
    place, cast = split_cast(path)
    if len(avatar_paths(place)) < TRAIN_MIN + TEST_MIN or cast:
        return path, path
    return with_cast(place, TRAIN), with_cast(place, TEST)


def members(avatars: Mapping[str, Value], cast: str) -> dict[str, Value]:
    """Those of some avatars that belong to a cast, by the hashes of their names.

    Args:
        avatars: By name.
        cast: "train", "test", or "" for all.

    Raises:
        AvatarError: If they are too few to be split.
    """
    if not cast:
        return dict(avatars)
    if len(avatars) < TRAIN_MIN + TEST_MIN:
        raise AvatarError(
            f"Avatars are split from {TRAIN_MIN + TEST_MIN} on, {TRAIN_MIN} to train with and {TEST_MIN} to test with; "
            f"there are {len(avatars)}."
        )
    ranked = sorted(avatars, key=lambda name: hashlib.sha256(name.encode()).hexdigest())
    kept = set(ranked[: max(TEST_MIN, len(ranked) // TEST_SHARE)])
    return {name: avatar for name, avatar in avatars.items() if (name in kept) == (cast == TEST)}
