"""`readygo avatar import`: a file in, an avatar and a report out; mistakes end in one line and exit code 2."""

import dataclasses
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.__main__ import main
from readygo.apps.commands.avatar_import import AvatarImportOptions, _has_wide_scales, _print_report, avatar_import
from readygo.common.avatars import load_avatar, load_avatars
from readygo.common.avatars.importers import ImportReport
from readygo.common.avatars.importers.report import SkeletonReport
from readygo.common.errors import AvatarError
from readygo.common.gaussians import save_ply
from tests.common.avatars.importers.humans import write_glb


def test_report_as_json_describes_the_avatar_that_was_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    person = write_glb(tmp_path / "person.glb")
    avatar_import(
        AvatarImportOptions(
            file=person, out=tmp_path / "ann.npz", license="CC-BY 4.0, me", gaussians=3000, preview=True, json=True
        )
    )
    report = json.loads(capsys.readouterr().out)
    avatar = load_avatar(tmp_path / "ann.npz")
    assert (avatar.name, avatar.license) == ("ann", "CC-BY 4.0, me")
    assert report["gaussians"] == len(avatar.cloud)
    assert report["height_m"] == pytest.approx(avatar.height_m)
    assert report["skeleton"]["bone_of_joint"]["left_knee"] == "mixamorig:LeftLeg"
    assert (tmp_path / "ann.png").stat().st_size > 10_000


def test_printed_report_names_bones_and_license(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    person = write_glb(tmp_path / "person.glb", prefix="[rig] ")
    avatar_import(AvatarImportOptions(file=person, out=tmp_path / "ann.npz", license="CC0-1.0", gaussians=2000))
    printed = capsys.readouterr().out
    assert "left_knee       [rig] LeftLeg" in printed
    assert "license: CC0-1.0" in printed
    assert not (tmp_path / "ann.png").exists()


def test_small_scales_survive_beside_large_ones(tmp_path: Path) -> None:
    source = next(iter(load_avatars().values()))
    scales = source.cloud.scales_m.copy()
    scales[:10] = 0.5
    cloud = type(source.cloud)(**{**vars(source.cloud), "scales_m": scales})
    save_ply(cloud, tmp_path / "p.ply")
    np.savez(
        tmp_path / "w.npz",
        lbs_index=source.lbs_index,
        lbs_weight=source.lbs_weight,
        joints_canonical=source.joints_canonical_m,
        joints_tpose=source.joints_tpose_m,
        R_canonical_to_tpose=source.R_tpose_canonical,
    )
    avatar_import(
        AvatarImportOptions(file=tmp_path / "p.ply", out=tmp_path / "a.npz", license="x", weights=tmp_path / "w.npz")
    )
    loaded = load_avatar(tmp_path / "a.npz").cloud.scales_m
    np.testing.assert_allclose(loaded[10:] / scales[10:], loaded[10, 0] / scales[10, 0], rtol=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["person.glb", "--out", "a.png", "--license", "x"], "must end in .npz"),
        (["person.glb", "--out", "a.npz", "--license", ""], "--license must say"),
        (["no.glb", "--out", "a.npz", "--license", "x" * 2001], "license has at most 2000 characters, got 2001"),
        (["no.glb", "--out", "a.npz", "--license", "x", "--name", "n" * 2001], "name has at most 2000 characters"),
        (["nothing.glb", "--out", "a.npz", "--license", "x"], "No such file"),
        (["person.glb", "--out", "a.npz", "--license", "x", "--height-m", "9"], "--height-m must lie in"),
    ],
)
def test_mistakes_end_in_one_line_and_exit_code_2(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    write_glb(tmp_path / "person.glb")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["readygo", "avatar", "import", *arguments])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    error = capsys.readouterr().err
    assert message in error
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "a.npz").exists()


def test_humans_who_cannot_walk_are_refused(tmp_path: Path) -> None:
    source = next(iter(load_avatars().values()))
    joints = source.joints_tpose_m.copy()
    joints[[10, 11], 2] = joints[[7, 8], 2] - 0.2
    save_ply(source.cloud, tmp_path / "p.ply")
    np.savez(
        tmp_path / "w.npz",
        lbs_index=source.lbs_index,
        lbs_weight=source.lbs_weight,
        joints_canonical=source.joints_canonical_m,
        joints_tpose=joints,
        R_canonical_to_tpose=source.R_tpose_canonical,
    )
    with pytest.raises(AvatarError, match="cannot walk"):
        avatar_import(
            AvatarImportOptions(
                file=tmp_path / "p.ply", out=tmp_path / "a.npz", license="x", weights=tmp_path / "w.npz"
            )
        )
    assert not (tmp_path / "a.npz").exists()


def test_report_tells_all_that_was_done(capsys: pytest.CaptureFixture[str]) -> None:
    skeleton = SkeletonReport(
        bone_of_joint={"pelvis": "[hips]"}, estimated=("left_hand", "neck"),
        merged={"toe": "left_foot", "tail": "pelvis"}, source="geometry",
    )  # fmt: skip
    report = ImportReport(
        kind="figure", name="ann", license="CC0", gaussians=12345, height_m=1.678, scale=0.01, skeleton=skeleton,
        notes=("It has no hands.",),
    )  # fmt: skip
    _print_report(report, Path("ann.npz"), Path("ann.png"))
    assert capsys.readouterr().out.splitlines() == [
        "ann.npz: ann, a figure, 1.68 m tall, 12,345 Gaussians",
        "license: CC0",
        "skeleton, recognised by geometry:",
        "  pelvis          [hips]",
        "  estimated: left_hand, neck",
        "  merged: toe -> left_foot, tail -> pelvis",
        "It has no hands.",
        "preview: ann.png",
    ]
    _print_report(dataclasses.replace(report, skeleton=None, notes=()), Path("ann.npz"), None)
    assert len(capsys.readouterr().out.splitlines()) == 2


@pytest.mark.parametrize(("largest_m", "wide"), [(0.1, False), (0.11, True)])
def test_scales_are_wide_from_ten_times_the_median_on(largest_m: float, wide: bool) -> None:
    scales_m = np.tile([0.001, 0.01, 0.002], (5, 1))
    scales_m[3, 0] = largest_m
    assert _has_wide_scales(SimpleNamespace(cloud=SimpleNamespace(scales_m=scales_m))) is wide  # type: ignore[arg-type]
