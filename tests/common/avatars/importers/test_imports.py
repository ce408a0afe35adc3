"""One door: files are told apart by content, and refused with a reason."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.avatars import load_avatar, load_avatars, save_avatar
from readygo.common.avatars.file import EMBEDDED_FOLDER
from readygo.common.avatars.importers import FileKind, ImportOptions, import_human, kind_of
from readygo.common.errors import AvatarError, SceneError
from readygo.common.gaussians import save_ply
from tests.common.avatars.importers.humans import write_glb, write_smpl_npz, write_smpl_pickle


@pytest.fixture(scope="module")
def bound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """An embedded avatar as .ply and weights."""
    folder = tmp_path_factory.mktemp("bound")
    avatar = next(iter(load_avatars().values()))
    save_ply(avatar.cloud, folder / "human.ply")
    np.savez(
        folder / "weights.npz",
        lbs_index=avatar.lbs_index,
        lbs_weight=avatar.lbs_weight,
        joints_canonical=avatar.joints_canonical_m,
        joints_tpose=avatar.joints_tpose_m,
        R_canonical_to_tpose=avatar.R_tpose_canonical,
    )
    return folder / "human.ply", folder / "weights.npz"


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


def test_bound_gaussians_come_back_as_the_avatar_they_were(bound: tuple[Path, Path]) -> None:
    source = next(iter(load_avatars().values()))
    options = ImportOptions(license="test", weights=bound[1], height_m=source.height_m)
    avatar, report = import_human(bound[0], options)
    assert report.kind == "3DGS .ply with weights"
    # Heights are measured between percentiles of Gaussians, so sizes may differ by a few millimetres.
    np.testing.assert_allclose(avatar.cloud.means_m, source.cloud.means_m, atol=0.02)
    np.testing.assert_allclose(avatar.joints_tpose_m, source.joints_tpose_m, atol=0.02)
    dense = [np.zeros((len(source.cloud), 24)) for _ in range(2)]
    for array, human in zip(dense, (avatar, source), strict=True):
        np.add.at(array, (np.arange(len(array))[:, None], human.lbs_index), human.lbs_weight)
    np.testing.assert_allclose(dense[0], dense[1], atol=1e-6)


def test_result_can_be_saved_and_loaded(bound: tuple[Path, Path], tmp_path: Path) -> None:
    avatar, _ = import_human(bound[0], ImportOptions(license="CC0-1.0", name="ann", weights=bound[1]))
    save_avatar(avatar, tmp_path / "ann.npz")
    loaded = load_avatar(tmp_path / "ann.npz")
    assert (loaded.name, loaded.license) == ("ann", "CC0-1.0")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lbs_weight": None}, "lacks lbs_weight"),
        ({"joints_canonical": None}, "lacks joints_canonical"),
        ({"lbs_weight": np.ones((5, 4))}, "must have a row for each"),
        ({"lbs_weight": np.nan}, "lbs_weight holds values that are not finite"),
        ({"lbs_weight": 0.0}, "no skinning weight"),
        ({"lbs_weight": -1.0}, "must not be negative"),
        ({"lbs_index": 99}, "joints 0..23"),
        ({"joints_tpose": np.zeros((5, 3))}, r"joints_tpose must have shape \(24, 3\)"),
        ({"R_canonical_to_tpose": 0.3}, "must hold rotation matrices"),
    ],
)
def test_weights_that_do_not_fit_are_refused(
    bound: tuple[Path, Path], tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    with np.load(bound[1]) as archive:
        entries = dict(archive)
    for key, value in change.items():
        if value is None:
            del entries[key]
        elif np.isscalar(value):
            entries[key] = np.full_like(entries[key], value)
        else:
            entries[key] = value
    np.savez(tmp_path / "w.npz", **entries)
    with pytest.raises(AvatarError, match=message):
        import_human(bound[0], ImportOptions(license="test", weights=tmp_path / "w.npz"))


def test_upside_down_humans_are_refused(bound: tuple[Path, Path], tmp_path: Path) -> None:
    with np.load(bound[1]) as archive:
        entries = dict(archive)
    entries["joints_canonical"] = entries["joints_canonical"] * [1, -1, -1]
    np.savez(tmp_path / "w.npz", **entries)
    with pytest.raises(AvatarError, match="y must point up"):
        import_human(bound[0], ImportOptions(license="test", weights=tmp_path / "w.npz"))


def test_gaussians_without_weights_and_plain_point_clouds_are_refused(bound: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(AvatarError, match="--weights"):
        import_human(bound[0], ImportOptions(license="test"))
    (tmp_path / "x.ply").write_bytes(b"ply\nformat ascii 1.0\nend_header\n")
    with pytest.raises(SceneError):
        import_human(tmp_path / "x.ply", ImportOptions(license="test", weights=bound[1]))


def test_options_are_checked() -> None:
    with pytest.raises(AvatarError, match="--license"):
        ImportOptions(license=" ")
    with pytest.raises(AvatarError, match="--gaussians"):
        ImportOptions(license="x", gaussians=3)
    with pytest.raises(AvatarError, match="--height-m"):
        ImportOptions(license="x", height_m=float("nan"))


def test_importers_load_no_heavy_libraries() -> None:
    import subprocess
    import sys

    code = "import readygo.common.avatars.importers, sys; print([m for m in ('torch', 'cv2', 'zenoh') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
