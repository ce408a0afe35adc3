from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars import load_avatars
from readygo.common.avatars.avatar import Avatar
from readygo.common.avatars.file import load_avatar
from readygo.common.avatars.variants import vary_avatar, write_variants
from readygo.common.errors import AvatarError


@pytest.fixture(scope="module")
def avatar() -> Avatar:
    return load_avatars()["gil"]


def test_variant_is_of_another_size_and_colour_and_bound_the_same_way(avatar: Avatar) -> None:
    made = vary_avatar(avatar, "gil_1", np.random.default_rng(1))
    scale = made.height_m / avatar.height_m
    assert made.name == "gil_1"
    assert scale != 1.0
    np.testing.assert_allclose(made.cloud.means_m, avatar.cloud.means_m * scale, rtol=1e-5)
    np.testing.assert_allclose(made.joints_tpose_m, avatar.joints_tpose_m * scale, rtol=1e-5)
    np.testing.assert_array_equal(made.lbs_weight, avatar.lbs_weight)
    rgb = 0.5 + 0.28209479177387814 * made.cloud.sh[:, 0]
    assert rgb.min() > 0.0
    assert rgb.max() < 1.0
    assert np.abs(made.cloud.sh - avatar.cloud.sh).mean() > 0.2


def test_variants_differ_by_the_draw_and_come_again(avatar: Avatar) -> None:
    first, again, other = (vary_avatar(avatar, "a", np.random.default_rng(seed)) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.cloud.sh, again.cloud.sh)
    assert np.abs(first.cloud.sh - other.cloud.sh).mean() > 0.2


def test_folder_of_variants_is_continued_and_no_other_folder_is_touched(tmp_path: Path) -> None:
    out = tmp_path / "people"
    first = write_variants(Path("embedded:test"), out, 2, seed=5)
    written = [path.stat().st_mtime_ns for path in first]
    both = write_variants(Path("embedded:test"), out, 3, seed=5)
    assert both[:2] == first
    assert [path.stat().st_mtime_ns for path in first] == written
    assert {load_avatar(path).name for path in both} == {path.stem for path in both}
    (out / "notes.txt").write_text("mine")
    for place, count in ((out, 3), (tmp_path / "new", 0)):
        with pytest.raises(AvatarError):
            write_variants(Path("embedded:test"), place, count, seed=5)
    assert not (tmp_path / "new").exists()
