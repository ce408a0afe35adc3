from pathlib import Path

import numpy as np
import pytest

from readygo.common.arrays import Float64Array
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
    np.testing.assert_allclose(made.joints_canonical_m, avatar.joints_canonical_m * scale, rtol=1e-5)
    np.testing.assert_allclose(made.joints_tpose_m, avatar.joints_tpose_m * scale, rtol=1e-5)
    np.testing.assert_array_equal(made.lbs_weight, avatar.lbs_weight)
    rgb = colours(made)
    assert rgb.min() > 0.0
    assert rgb.max() < 1.0
    assert np.abs(made.cloud.sh - avatar.cloud.sh).mean() > 0.2


@pytest.mark.parametrize("seed", range(4))
def test_skin_is_of_one_tone_from_head_to_hands_and_clothes_are_of_others(avatar: Avatar, seed: int) -> None:
    made = vary_avatar(avatar, "gil_1", np.random.default_rng(seed))
    strongest = avatar.lbs_index[np.arange(len(avatar.cloud)), np.argmax(avatar.lbs_weight, axis=1)]
    hands = np.isin(strongest, (22, 23))
    face = (strongest == 15) & (
        np.linalg.norm(colours(avatar) - np.median(colours(avatar)[hands], axis=0), axis=1) < 0.1
    )
    assert hands.sum() > 100
    assert face.sum() > 100
    hues = [colours(made)[part] / colours(made)[part].sum(axis=1, keepdims=True) for part in (hands, face)]
    np.testing.assert_allclose(np.median(hues[0], axis=0), np.median(hues[1], axis=0), atol=0.01)
    red, green, blue = np.median(hues[0], axis=0)
    assert red > green > blue


def test_trunk_and_limbs_are_wider_or_thinner_but_head_hands_and_feet_are_not(avatar: Avatar) -> None:
    widths = []
    for seed in range(8):
        made = vary_avatar(avatar, "gil_1", np.random.default_rng(seed))
        moved = made.cloud.means_m / (made.height_m / avatar.height_m) - avatar.cloud.means_m
        only = avatar.lbs_weight.max(axis=1) > 0.999
        strongest = avatar.lbs_index[np.arange(len(avatar.cloud)), np.argmax(avatar.lbs_weight, axis=1)]
        rigid = only & np.isin(strongest, (7, 8, 10, 11, 15, 22, 23))
        assert rigid.sum() > 100
        np.testing.assert_allclose(moved[rigid], 0.0, atol=1e-5)
        widths.append(np.abs(moved[~rigid]).max())
        trunk = np.isin(strongest, (3, 6, 9))
        # The bones of the trunk point upwards: it does not grow.
        assert np.abs(moved[trunk, 1]).max() < 0.6 * np.abs(moved[trunk]).max()
    assert 0.005 < min(widths) < 0.06
    assert 0.02 < max(widths) < 0.2


def colours(avatar: Avatar) -> Float64Array:
    return 0.5 + 0.28209479177387814 * avatar.cloud.sh[:, 0].astype(np.float64)


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
