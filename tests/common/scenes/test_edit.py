import numpy as np
import pytest

from readygo.common.errors import NoGroundError, SceneError
from readygo.common.frames import matrix_from_axis_angle, matrix_from_quat
from readygo.common.gaussians import GaussianCloud, concatenate, sh_basis, transform_cloud
from readygo.common.scenes.edit import Box, clean_cloud, crop_box, crop_cloud, levelling, mirror_cloud, room_scale
from tests.common.maps.room import box, room, sheet


def furnished():
    return concatenate([room(), box((1, 1, 0), (2, 1.5, 0.8)), box((3, 3, 0), (4.5, 4, 0.5))])


def test_crop_keeps_what_lies_in_the_box_and_names_it():
    part = crop_box((0.5, 0.5, 2.5, 2.0), (0.0, 1.0))
    kept = crop_cloud(furnished(), part)
    assert kept.means_m.min(axis=0) == pytest.approx([0.5, 0.5, 0.0], abs=0.1)
    assert kept.means_m[:, 2].max() <= 1.0
    assert str(part) == "x 0.5..2.5 m, y 0.5..2 m, z 0..1 m"
    assert crop_box(None, None) is None
    with pytest.raises(SceneError, match=r"Nothing is left .* it lies at x 0"):
        crop_cloud(furnished(), crop_box((50, 50, 60, 60), None))
    with pytest.raises(SceneError, match="low corner below"):
        crop_box((1, 1, 0, 2), None)


def test_clean_removes_and_counts_each_kind():
    far = box((30, 30, 20), (30.1, 30.1, 20.1))
    huge = box((0, 0, 0), (0.3, 0.3, 0.3)).select(np.arange(3))
    huge = type(huge)(**{**vars_of(huge), "scales_m": np.full((3, 3), 500, np.float32)})
    cloud, words = clean_cloud(concatenate([furnished(), far, huge]), ("huge", "floaters"))
    assert len(cloud) == len(furnished())
    assert words == f"huge: 3, floaters: {len(far)}"
    with pytest.raises(SceneError, match="Unknown kind"):
        clean_cloud(cloud, ("dust",))


def vars_of(cloud):
    return {name: getattr(cloud, name) for name in ("means_m", "quats_wxyz", "scales_m", "opacities", "sh")}


def test_levelling_turns_the_floor_level_at_height_0():
    tilted = transform_cloud(furnished(), matrix_from_axis_angle([0.1, 0.05, 0.0]), (0, 0, 3.0))
    R, translate_m, _ = levelling(tilted, "auto")
    level = transform_cloud(tilted, R, translate_m)
    assert np.quantile(level.means_m[:, 2], 0.02) == pytest.approx(0.0, abs=0.05)
    assert np.quantile(level.means_m[:, 2], 0.98) == pytest.approx(2.5, abs=0.05)


def test_room_scale_gives_the_room_its_height():
    assert room_scale(transform_cloud(furnished(), np.eye(3), scale=0.2), 2.5) == pytest.approx(5.0, rel=0.03)


def test_mirror_image_has_mirrored_places_shapes_and_colours_and_mirrors_back():
    rng = np.random.default_rng(0)
    cloud = furnished()
    cloud = type(cloud)(**{**vars_of(cloud), "sh": rng.normal(size=(len(cloud), 16, 3)).astype(np.float32)})
    image, flip = mirror_cloud(cloud), np.array([-1.0, 1.0, 1.0])
    direction = np.array([[0.6, -0.64, 0.48]])
    colour, seen = sh_basis(direction, 3)[0] @ cloud.sh[7], sh_basis(direction * flip, 3)[0] @ image.sh[7]
    np.testing.assert_allclose(seen, colour, atol=1e-5)
    back = mirror_cloud(image)
    for name, array in vars_of(cloud).items():
        np.testing.assert_array_equal(getattr(back, name), array)
    assert image.means_m[:, 0].max() <= 0.0


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
def test_mirror_image_of_turned_gaussians_has_their_mirrored_covariances(coefficients):
    rng = np.random.default_rng(1)
    quats = rng.normal(size=(30, 4))
    cloud = GaussianCloud(
        means_m=rng.normal(size=(30, 3)).astype(np.float32),
        quats_wxyz=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales_m=rng.uniform(0.01, 0.3, (30, 3)).astype(np.float32),
        opacities=rng.random(30).astype(np.float32),
        sh=rng.normal(size=(30, coefficients, 3)).astype(np.float32),
    )
    image, flip = mirror_cloud(cloud), np.diag([-1.0, 1.0, 1.0])
    np.testing.assert_array_equal(image.means_m, cloud.means_m @ flip.astype(np.float32))
    before, after = (
        np.einsum("nij,nj,nkj->nik", R, one.scales_m**2, R)
        for one, R in ((cloud, matrix_from_quat(cloud.quats_wxyz)), (image, matrix_from_quat(image.quats_wxyz)))
    )
    np.testing.assert_allclose(after, flip @ before @ flip, atol=1e-7)
    np.testing.assert_array_equal(image.opacities, cloud.opacities)
    directions = rng.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    degree = cloud.sh_degree
    colours = np.einsum("dk,nkc->ndc", sh_basis(directions, degree), cloud.sh)
    seen = np.einsum("dk,nkc->ndc", sh_basis(directions @ flip, degree), image.sh)
    np.testing.assert_allclose(seen, colours, atol=2e-6)


def test_crop_is_closed_at_its_corners_and_open_where_no_side_is_given():
    cloud = furnished().select(np.arange(8))
    cloud = type(cloud)(**{**vars_of(cloud), "means_m": np.float32([[k, 2 * k, -k] for k in range(8)])})
    for part, kept in (
        (crop_box((1, 2, 5, 8), None), [1, 2, 3, 4]), (crop_box(None, (-6, -2)), [2, 3, 4, 5, 6]),
        (crop_box((2, -9, 9, 99), (-4, 9)), [2, 3, 4]), (Box(low=(5.5, -99, -99)), [6, 7]),
    ):  # fmt: skip
        assert crop_cloud(cloud, part).means_m[:, 0].tolist() == kept
    assert str(crop_box(None, (0, 2.5))) == "z 0..2.5 m"
    with pytest.raises(SceneError, match="low corner below"):
        Box(low=(0.0, 0.0, 1.0), high=(1.0, 1.0, 1.0))


def test_floor_up_to_45_deg_off_is_levelled_and_a_scene_on_its_side_is_not():
    for turn_rad, is_floor in ((0.6, True), (-1.3, False)):
        cloud = transform_cloud(furnished(), matrix_from_axis_angle([turn_rad, 0.0, 0.0]), (0.3, -0.2, 1.7))
        if is_floor:
            R, translate_m, up = levelling(cloud, "auto")
            found = np.array([float(word) for word in up.split(",")])
            np.testing.assert_allclose(found, [0.0, -np.sin(turn_rad), np.cos(turn_rad)], atol=0.02)
            heights_m = transform_cloud(cloud, R, translate_m).means_m[: len(room()), 2]
            assert np.quantile(heights_m, 0.02) == pytest.approx(0.0, abs=0.06)
            assert translate_m[:2].tolist() == [0.0, 0.0]
        else:
            with pytest.raises(NoGroundError, match="within 45 deg"):
                levelling(cloud.select(np.arange(len(sheet((0, 0, 0), (6, 0, 0), (0, 5, 0))))), "auto")
