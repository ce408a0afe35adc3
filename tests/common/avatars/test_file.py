import dataclasses
import os
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.avatars import (
    POSES_ENDING,
    SMPL_PARENTS,
    Avatar,
    avatar_hash,
    avatar_paths,
    load_avatar,
    load_avatars,
    save_avatar,
)
from readygo.common.errors import AvatarError
from readygo.common.gaussians import GaussianCloud


def make_avatar(name: str = "test", count: int = 50, seed: int = 3) -> Avatar:
    rng = np.random.default_rng(seed)
    quats = rng.normal(size=(count, 4))
    weights = rng.random((count, 4))
    joints = rng.uniform(-0.5, 1.8, (24, 3)).astype(np.float32)
    return Avatar(
        name=name,
        license="CC0-1.0",
        height_m=1.7,
        cloud=GaussianCloud(
            means_m=rng.uniform(-0.5, 1.8, (count, 3)).astype(np.float32),
            quats_wxyz=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
            scales_m=rng.uniform(0.001, 0.01, (count, 3)).astype(np.float32),
            opacities=rng.uniform(0.2, 1.0, count).astype(np.float32),
            sh=rng.uniform(-1.5, 1.5, (count, 1, 3)).astype(np.float32),
        ),
        lbs_index=rng.integers(0, 24, (count, 4)).astype(np.uint8),
        lbs_weight=(weights / weights.sum(axis=1, keepdims=True)).astype(np.float32),
        joints_canonical_m=joints,
        joints_tpose_m=joints[::-1].copy(),
        R_tpose_canonical=np.tile(np.eye(3, dtype=np.float32), (24, 1, 1)),
    )


def entries_of(path: Path) -> dict[str, Any]:
    with np.load(path) as archive:
        return {key: archive[key] for key in archive.files}


@pytest.fixture
def plain_file(tmp_path: Path) -> Path:
    path = tmp_path / "plain.npz"
    save_avatar(make_avatar(), path, quantise=False)
    return path


def test_unquantised_file_round_trips_exactly(plain_file: Path) -> None:
    avatar, again = make_avatar(), load_avatar(plain_file)
    for field in ("means_m", "scales_m", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(again.cloud, field), getattr(avatar.cloud, field))
    np.testing.assert_allclose(again.cloud.quats_wxyz, avatar.cloud.quats_wxyz, atol=1e-7)
    np.testing.assert_allclose(again.lbs_weight, avatar.lbs_weight, atol=1e-7)
    for field in ("lbs_index", "joints_canonical_m", "joints_tpose_m", "R_tpose_canonical"):
        np.testing.assert_array_equal(getattr(again, field), getattr(avatar, field))
    assert (again.name, again.license, again.height_m) == ("test", "CC0-1.0", 1.7)


def test_quantised_file_is_close_and_smaller(plain_file: Path, tmp_path: Path) -> None:
    avatar = make_avatar(count=2000)
    path, large = tmp_path / "small.npz", tmp_path / "large.npz"
    save_avatar(avatar, path)
    save_avatar(avatar, large, quantise=False)
    again = load_avatar(path)
    assert np.abs(again.cloud.means_m - avatar.cloud.means_m).max() <= 0.0005
    assert np.abs(again.cloud.sh - avatar.cloud.sh).max() <= 3.0 / 510 + 1e-6
    assert np.abs(again.cloud.scales_m - avatar.cloud.scales_m).max() <= 0.009 / 510 + 1e-8
    assert np.abs(again.lbs_weight - avatar.lbs_weight).max() < 0.01
    np.testing.assert_allclose(np.linalg.norm(again.cloud.quats_wxyz, axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(again.lbs_weight.sum(axis=1), 1.0, atol=1e-6)
    assert path.stat().st_size < 0.45 * large.stat().st_size


def test_saving_a_loaded_avatar_changes_nothing_but_rounding(tmp_path: Path) -> None:
    save_avatar(make_avatar(), tmp_path / "a.npz")
    first = load_avatar(tmp_path / "a.npz")
    save_avatar(first, tmp_path / "b.npz", quantise=False)
    assert np.abs(load_avatar(tmp_path / "b.npz").cloud.sh - first.cloud.sh).max() == 0.0


def test_constant_array_survives_quantisation(tmp_path: Path) -> None:
    avatar = make_avatar()
    avatar.cloud.opacities[:] = np.float32(0.7)
    save_avatar(avatar, tmp_path / "a.npz")
    np.testing.assert_allclose(load_avatar(tmp_path / "a.npz").cloud.opacities, 0.7, atol=1e-7)


def test_eight_bit_array_with_scalar_range_loads(plain_file: Path) -> None:
    entries = entries_of(plain_file)
    entries["opacities"] = np.full(50, 51, dtype=np.uint8)
    entries |= {"opacities_min": np.float32(0.0), "opacities_max": np.float32(1.0)}
    np.savez(plain_file, **entries)
    np.testing.assert_allclose(load_avatar(plain_file).cloud.opacities, 0.2, atol=1e-6)


Change = Callable[[dict[str, Any]], Any]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda e: e.pop("sh"), "lacks sh"),
        (lambda e: e.pop("joints_tpose"), "joints_tpose"),
        (lambda e: e.update(format=np.array("other/2")), "other/2"),
        (lambda e: e.update(means=e["means"][:-1]), "shape"),
        (lambda e: e.update(means=np.zeros(())), "shape"),
        (lambda e: e.update(sh=np.zeros((50, 2, 3))), "1, 4, 9 or 16"),
        (lambda e: e.update(scales=np.full((50, 3), np.nan)), "scales hold values that are not finite"),
        (lambda e: e.update(scales=np.zeros((50, 3))), "positive"),
        (lambda e: e.update(opacities=np.full(50, 1.5)), "0..1"),
        (lambda e: e.update(quats_wxyz=np.zeros((50, 4))), "zero quaternion"),
        (lambda e: e.update(lbs_weight=np.zeros((50, 4))), "row of zeros"),
        (lambda e: e.update(lbs_index=np.full((50, 4), 24)), "0..23"),
        (lambda e: e.update(lbs_index=np.zeros((50, 4))), "integers"),
        (lambda e: e.update(parents=SMPL_PARENTS[::-1].copy()), "skeleton"),
        (lambda e: e.update(sh=np.zeros((50, 1, 3), dtype=np.uint8)), "sh_min"),
        (
            lambda e: e.update(opacities=np.zeros(50, np.uint8), opacities_min=np.zeros(7), opacities_max=np.ones(7)),
            "do not fit",
        ),
        (lambda e: e.update(height_m=np.float32(np.nan)), "height_m"),
    ],
)
def test_defect_is_named_in_one_line_with_the_file(plain_file: Path, change: Change, words: str) -> None:
    entries = entries_of(plain_file)
    change(entries)
    np.savez(plain_file, **entries)
    with pytest.raises(AvatarError) as error:
        load_avatar(plain_file)
    assert words in str(error.value)
    assert str(plain_file) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("data", [b"", b"no archive", b"PK\x03\x04 cut short", b"\x93NUMPY\x01\x00"])
def test_file_that_is_no_archive_is_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "bad.npz"
    path.write_bytes(data)
    with pytest.raises(AvatarError, match=r"bad\.npz"):
        load_avatar(path)


def test_truncated_file_is_refused(plain_file: Path) -> None:
    plain_file.write_bytes(plain_file.read_bytes()[:-200])
    with pytest.raises(AvatarError):
        load_avatar(plain_file)


def test_corrupted_array_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    save_avatar(make_avatar(count=500), path)
    data = bytearray(path.read_bytes())
    data[2000:2400] = bytes(400)
    path.write_bytes(bytes(data))
    with pytest.raises(AvatarError):
        load_avatar(path)


def test_single_array_file_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "array.npz").open("wb") as stream:
        np.save(stream, np.zeros(3))
    with pytest.raises(AvatarError, match="not a readable NumPy archive"):
        load_avatar(tmp_path / "array.npz")


def test_pickled_object_is_never_loaded(plain_file: Path) -> None:
    entries = entries_of(plain_file)
    entries["means"] = np.array([{"a": 1}], dtype=object)
    np.savez(plain_file, **entries)
    with pytest.raises(AvatarError):
        load_avatar(plain_file)


def test_failed_save_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.npz").mkdir()
    with pytest.raises(AvatarError, match=r"a\.npz cannot be written"):
        save_avatar(make_avatar(), tmp_path / "a.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_folder_gives_avatars_sorted_by_name(tmp_path: Path) -> None:
    save_avatar(make_avatar("zoe"), tmp_path / "1.npz")
    save_avatar(make_avatar("ann"), tmp_path / "2.npz")
    assert list(load_avatars(tmp_path)) == ["ann", "zoe"]
    assert list(load_avatars(tmp_path / "2.npz")) == ["ann"]


def test_two_avatars_of_one_name_are_refused(tmp_path: Path) -> None:
    for file in ("1.npz", "2.npz"):
        save_avatar(make_avatar("ann"), tmp_path / file)
    with pytest.raises(AvatarError, match="'ann'"):
        load_avatars(tmp_path)


def test_empty_and_missing_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(AvatarError, match="no avatar"):
        load_avatars(tmp_path)
    with pytest.raises(AvatarError, match="does not exist"):
        avatar_paths(tmp_path / "nowhere")


def test_hash_tells_avatars_apart_but_not_their_compression(tmp_path: Path) -> None:
    save_avatar(make_avatar(), tmp_path / "a.npz")
    avatar = load_avatar(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", **entries_of(tmp_path / "a.npz"))
    assert avatar_hash(load_avatar(tmp_path / "b.npz")) == avatar_hash(avatar)
    assert avatar_hash(make_avatar(seed=4)) != avatar_hash(make_avatar())
    assert avatar_hash(make_avatar("other")) != avatar_hash(make_avatar())


def test_shared_avatars_load_as_they_are(shared_data: Path) -> None:
    avatars = load_avatars(shared_data / "avatars")
    assert len(avatars) == 4
    assert all(1.5 < avatar.height_m < 2.0 for avatar in avatars.values())


SIGFPE = b"\x93NUMPY\x01\x00F\x00" + b"{'descr': 'm8[s/0]', 'fortran_order': False, 'shape': (), }".ljust(69) + b"\n"


@pytest.mark.parametrize("data", [SIGFPE, b"no array", b"\x93NUMPY\x01\x00F\x00" + b"(" * 70])
def test_array_that_is_none_is_refused_in_one_line(plain_file: Path, data: bytes) -> None:
    """The first one ends a process in which NumPy reads it, with SIGFPE."""
    with zipfile.ZipFile(plain_file) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(plain_file, "w") as archive:
        for name, entry in (entries | {"means.npy": data}).items():
            archive.writestr(name, entry)
    with pytest.raises(AvatarError, match=r"is not a readable NumPy archive \(\.npz\): means: ") as error:
        load_avatar(plain_file)
    assert "\n" not in str(error.value)


def test_archive_that_unpacks_to_a_gigabyte_costs_nothing(plain_file: Path) -> None:
    entries = entries_of(plain_file)
    np.savez_compressed(plain_file, **(entries | {"other": np.zeros(2**26, np.uint8)}))
    tracemalloc.start()
    load_avatar(plain_file)
    assert tracemalloc.get_traced_memory()[1] < 2**22
    np.savez_compressed(plain_file, **(entries | {"means": np.zeros((2**27 + 2**25, 2), np.uint8)}))
    tracemalloc.reset_peak()
    with pytest.raises(AvatarError, match=r"unpacks to 335[0-9]* bytes, 300000000 are read at most"):
        load_avatar(plain_file)
    assert tracemalloc.get_traced_memory()[1] < 2**22
    tracemalloc.stop()


def test_more_gaussians_than_an_avatar_has_are_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    save_avatar(make_avatar(count=50), tmp_path / "a.npz")
    monkeypatch.setattr("readygo.common.avatars.file.GAUSSIANS_MAX", 49)
    with pytest.raises(AvatarError, match="holds 50 Gaussians; an avatar has at most 49"):
        load_avatar(tmp_path / "a.npz")
    with pytest.raises(AvatarError, match="has 50 Gaussians; give at most 49"):
        save_avatar(make_avatar(count=50), tmp_path / "b.npz")


def test_ends_of_codes_that_would_repeat_an_array_do_not_fit(plain_file: Path) -> None:
    entries = entries_of(plain_file)
    entries |= {"opacities": np.zeros(50, np.uint8), "opacities_max": np.ones(50)}
    np.savez(plain_file, **entries, opacities_min=np.zeros((1000, 1)))
    with pytest.raises(AvatarError, match="do not fit"):
        load_avatar(plain_file)


@pytest.mark.parametrize("name", [np.array(["a", "b"]), np.array(7), np.array("x" * 3000)])
def test_name_that_is_no_text_is_refused(plain_file: Path, name: Any) -> None:
    np.savez(plain_file, **(entries_of(plain_file) | {"name": name}))
    with pytest.raises(AvatarError, match="name must be one text of at most 2000 characters"):
        load_avatar(plain_file)


def test_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.npz")
    with pytest.raises(AvatarError, match=r"a\.npz cannot be read: it is a pipe or a device"):
        load_avatars(tmp_path)


@pytest.mark.parametrize("what", ["name", "license"])
def test_texts_that_could_not_be_read_back_are_not_written(tmp_path: Path, what: str) -> None:
    longest = dataclasses.replace(make_avatar(), **{what: "x" * 2000})
    save_avatar(longest, tmp_path / "a.npz")
    assert getattr(load_avatar(tmp_path / "a.npz"), what) == "x" * 2000
    with pytest.raises(AvatarError, match=f"{what} has at most 2000 characters, got 2001; shorten it"):
        save_avatar(dataclasses.replace(longest, **{what: "x" * 2001}), tmp_path / "b.npz")
    assert not (tmp_path / "b.npz").exists()


def test_files_of_poses_beside_avatars_are_none(tmp_path: Path) -> None:
    np.savez(tmp_path / f"ann{POSES_ENDING}", root_m=np.zeros((8, 3)))
    with pytest.raises(AvatarError, match="no avatar"):
        avatar_paths(tmp_path)
    save_avatar(make_avatar("ann"), tmp_path / "ann.npz")
    assert list(load_avatars(tmp_path)) == ["ann"]
