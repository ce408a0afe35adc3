from pathlib import Path

import pytest

from readygo.common.avatars import load_avatars
from readygo.common.avatars.cast import learned_and_tested, load_cast, members, split_cast, with_cast
from readygo.common.errors import AvatarError


def test_embedded_avatars_are_six_to_train_with_and_two_to_test_with() -> None:
    train, test = (set(load_cast(with_cast(None, cast))) for cast in ("train", "test"))
    assert (len(train), len(test)) == (6, 2)
    assert train | test == set(load_avatars())


def test_who_belongs_to_a_cast_does_not_depend_on_what_avatars_are_called_by() -> None:
    names = [f"avatar {number}" for number in range(20)]
    test = set(members(dict.fromkeys(names), "test"))
    assert len(test) == 5
    assert test == set(members(dict.fromkeys(reversed(names)), "test"))
    assert members(dict.fromkeys(names), "") == dict.fromkeys(names)


def test_too_few_avatars_are_not_split() -> None:
    with pytest.raises(AvatarError, match="from 8 on"):
        members(dict.fromkeys("abcdefg"), "train")


def test_those_of_the_test_are_not_learned_from_where_they_can_be_split(tmp_path: Path) -> None:
    assert learned_and_tested(None) == (Path("embedded:train"), Path("embedded:test"))
    assert learned_and_tested(Path("embedded:train")) == (Path("embedded:train"), Path("embedded:train"))
    for number in range(8):
        assert number < 1 or learned_and_tested(tmp_path) == (tmp_path, tmp_path)
        (tmp_path / f"{number}.npz").touch()
    assert learned_and_tested(tmp_path) == (Path(f"{tmp_path}:train"), Path(f"{tmp_path}:test"))
    with pytest.raises(AvatarError, match="does not exist"):
        learned_and_tested(tmp_path / "none")


def test_casts_are_named_behind_a_colon(tmp_path: Path) -> None:
    assert split_cast(None) == (None, "")
    assert split_cast(Path("embedded:test")) == (None, "test")
    assert split_cast(tmp_path / "people:train") == (tmp_path / "people", "train")
    assert split_cast(tmp_path / "people:other") == (tmp_path / "people:other", "")
    (tmp_path / "really:test").mkdir()
    assert split_cast(tmp_path / "really:test") == (tmp_path / "really:test", "")
