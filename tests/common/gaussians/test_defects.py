import dataclasses

import numpy as np
import pytest

from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.defects import count_kinds, excessive, unusable, unwanted_masks, without


def cloud(count: int = 6) -> GaussianCloud:
    return GaussianCloud(
        means_m=np.zeros((count, 3), dtype=np.float32),
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (count, 1)),
        scales_m=np.full((count, 3), 0.1, dtype=np.float32),
        opacities=np.full(count, 0.5, dtype=np.float32),
        sh=np.zeros((count, 4, 3), dtype=np.float32),
    )


def with_value(field: str, value: float, *, rows: tuple[int, ...] = (1, 4)) -> GaussianCloud:
    array = getattr(cloud(), field).copy()
    array.reshape(len(array), -1)[list(rows), -1] = value
    return dataclasses.replace(cloud(), **{field: array})


@pytest.mark.parametrize(
    ("field", "value", "kind"),
    [
        ("means_m", np.nan, "position not finite"),
        ("means_m", -np.inf, "position not finite"),
        ("scales_m", np.inf, "scale not finite"),
        ("quats_wxyz", np.nan, "rotation not finite or zero"),
        ("opacities", np.nan, "opacity not finite"),
        ("sh", np.inf, "colour not finite"),
    ],
)
def test_numbers_that_are_not_finite_are_left_out_and_counted_by_kind(field: str, value: float, kind: str) -> None:
    bad = with_value(field, value)
    good, counts = without(bad, unusable(bad))
    assert counts == {kind: 2}
    assert len(good) == 4
    assert without(good, unusable(good)) == (good, {})


@pytest.mark.parametrize(
    ("field", "value", "kind"),
    [
        ("means_m", -1.01e4, "position beyond 10000 m"),
        ("scales_m", 1.01e4, "scale above 10000 m"),
        ("sh", 101.0, "colour beyond 100"),
    ],
)
def test_what_is_too_far_too_large_or_too_bright_is_counted_by_kind(field: str, value: float, kind: str) -> None:
    bad = with_value(field, value)
    good, counts = without(bad, excessive(bad))
    assert counts == {kind: 2}
    assert len(good) == 4


def test_rotation_of_length_zero_is_a_defect() -> None:
    quats = cloud().quats_wxyz.copy()
    quats[2] = 0
    assert unusable(dataclasses.replace(cloud(), quats_wxyz=quats))["rotation not finite or zero"].tolist() == [
        k == 2 for k in range(6)
    ]


def test_scale_of_zero_and_opacity_of_one_are_sound() -> None:
    for sound in (with_value("scales_m", 0.0), with_value("opacities", 1.0), with_value("opacities", 0.0)):
        good, counts = without(sound, unusable(sound) | excessive(sound))
        assert counts == {}
        assert good is sound


def test_gaussian_with_two_defects_is_one_gaussian() -> None:
    bad = dataclasses.replace(with_value("means_m", np.nan), opacities=with_value("opacities", np.nan).opacities)
    good, counts = without(bad, unusable(bad))
    assert counts == {"position not finite": 2, "opacity not finite": 2}
    assert len(good) == 4


def test_unwanted_gaussians_are_told_apart_by_kind():
    rng = np.random.default_rng(0)
    plain = cloud(4000)
    means = (rng.uniform(0, 5, (4000, 3)) * (1, 1, 0.02)).astype(np.float32)
    scales, opacities = np.full((4000, 3), 0.05, np.float32), plain.opacities.copy()
    scales[0], (scales[1], opacities[1]), means[2] = 500.0, (0.4, 0.05), (2.0, 2.0, 9.0)
    masks = unwanted_masks(dataclasses.replace(plain, means_m=means, scales_m=scales, opacities=opacities))
    assert {kind: np.flatnonzero(mask).tolist() for kind, mask in masks.items()} == {
        "huge": [0],
        "floaters": [2],
        "haze": [1],
    }
    assert count_kinds(masks) == "huge: 1, floaters: 1, haze: 1"
