"""The body with the most similar silhouettes is chosen, at the person's size."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.rasterizer.cpu import rasterizer as cpu_rasterizer
from readygo.common.rasterizer.packed.avatar import pack_avatar
from readygo.services.reconstructor.avatars import body as body_module
from readygo.services.reconstructor.avatars.body import (
    OVERLAP_SCALE,
    LikeBody,
    compare_bodies,
    overlap_of,
    scale_body,
    swap_sides,
    weights_of,
)
from readygo.services.reconstructor.avatars.footage import read_footage
from readygo.services.reconstructor.avatars.views import read_person


def test_true_body_is_chosen_and_scaled_back(plain_film: Path, coarse_body: Avatar) -> None:
    footage = read_footage(plain_film)
    person = read_person(footage, 96)
    wide = dataclasses.replace(
        coarse_body, cloud=dataclasses.replace(coarse_body.cloud, scales_m=5.0 * coarse_body.cloud.scales_m)
    )
    bodies = {"small": scale_body(coarse_body, 0.85), "wide": wide}
    first, second = compare_bodies(bodies, person, footage.pose_axis_angle, footage.root_m)
    body = first.body
    assert body.height_m == pytest.approx(coarse_body.height_m, rel=0.1)
    assert body.cloud.scales_m.max() < 2.0 * coarse_body.cloud.scales_m.max()
    assert first.overlap > 0.7
    assert second.overlap < first.overlap
    assert second.body.cloud.scales_m.max() > 2.0 * coarse_body.cloud.scales_m.max()


def test_weights_of_bodies_fall_with_what_their_silhouettes_lack(coarse_body: Avatar) -> None:
    bodies = [LikeBody(body=coarse_body, overlap=overlap) for overlap in (0.8, 0.8 - OVERLAP_SCALE, 0.5)]
    weights = weights_of(bodies)
    assert weights.sum() == pytest.approx(1.0)
    assert weights[1] / weights[0] == pytest.approx(np.exp(-1.0))
    assert weights[2] < 1e-6


def test_swapped_sides_fit_worse(plain_film: Path, coarse_body: Avatar) -> None:
    footage = read_footage(plain_film)
    person = read_person(footage, 96)
    swapped = swap_sides(footage.pose_axis_angle)
    np.testing.assert_array_equal(swap_sides(swapped), footage.pose_axis_angle)
    overlaps = [overlap_of(coarse_body, person, pose, footage.root_m) for pose in (footage.pose_axis_angle, swapped)]
    assert overlaps[0] > overlaps[1] + 0.1


def test_body_is_packed_once_for_all_frames(
    plain_film: Path, coarse_body: Avatar, monkeypatch: pytest.MonkeyPatch
) -> None:
    footage, packs = read_footage(plain_film), []
    monkeypatch.setattr(body_module, "pack_avatar", lambda body: packs.append(pack_avatar(body)) or packs[-1])
    monkeypatch.setattr(cpu_rasterizer, "pack_avatar", lambda body: pytest.fail("packed by the rasterizer"))
    overlap_of(coarse_body, read_person(footage, 96), footage.pose_axis_angle, footage.root_m)
    assert len(packs) == 1
