import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.frames import matrix_from_axis_angle
from readygo.common.gaussians import concatenate, sh_basis, transform_cloud
from readygo.common.scenes.edit import cleaned, crop_box, cropped, levelling, mirrored, room_scale
from tests.common.maps.room import box, room


def furnished():
    return concatenate([room(), box((1, 1, 0), (2, 1.5, 0.8)), box((3, 3, 0), (4.5, 4, 0.5))])


def test_crop_keeps_what_lies_in_the_box_and_names_it():
    part = crop_box((0.5, 0.5, 2.5, 2.0), (0.0, 1.0))
    kept = cropped(furnished(), part)
    assert kept.means_m.min(axis=0) == pytest.approx([0.5, 0.5, 0.0], abs=0.1)
    assert kept.means_m[:, 2].max() <= 1.0
    assert str(part) == "x 0.5..2.5 m, y 0.5..2 m, z 0..1 m"
    assert crop_box(None, None) is None
    with pytest.raises(SceneError, match=r"Nothing is left .* it lies at x 0"):
        cropped(furnished(), crop_box((50, 50, 60, 60), None))
    with pytest.raises(SceneError, match="low corner below"):
        crop_box((1, 1, 0, 2), None)


def test_clean_removes_and_counts_each_kind():
    far = box((30, 30, 20), (30.1, 30.1, 20.1))
    huge = box((0, 0, 0), (0.3, 0.3, 0.3)).select(np.arange(3))
    huge = type(huge)(**{**vars_of(huge), "scales_m": np.full((3, 3), 500, np.float32)})
    cloud, words = cleaned(concatenate([furnished(), far, huge]), ("huge", "floaters"))
    assert len(cloud) == len(furnished())
    assert words == f"huge: 3, floaters: {len(far)}"
    with pytest.raises(SceneError, match="Unknown kind"):
        cleaned(cloud, ("dust",))


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
    image, flip = mirrored(cloud), np.array([-1.0, 1.0, 1.0])
    direction = np.array([[0.6, -0.64, 0.48]])
    colour, seen = sh_basis(direction, 3)[0] @ cloud.sh[7], sh_basis(direction * flip, 3)[0] @ image.sh[7]
    np.testing.assert_allclose(seen, colour, atol=1e-5)
    back = mirrored(image)
    for name, array in vars_of(cloud).items():
        np.testing.assert_array_equal(getattr(back, name), array)
    assert image.means_m[:, 0].max() <= 0.0
