from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.avatars import load_avatars
from readygo.common.avatars.importers import ImportOptions, import_human
from readygo.common.errors import AvatarError


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
