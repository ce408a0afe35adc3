import numpy as np

from tests.services.reconstructor.synthetic import floor_points, mapped, ring, some_similarity


def test_moved_map_sees_the_same() -> None:
    images = mapped(ring(3), floor_points(9), some_similarity())
    moved = images.transform(some_similarity())

    def seen(which: object) -> np.ndarray:
        T = which.T_world_camera[1]
        xyz = (which.points - T[:3, 3]) @ T[:3, :3]
        return xyz[:, :2] / xyz[:, 2:]

    np.testing.assert_allclose(seen(moved), seen(images), atol=1e-12)
    assert moved.names == images.names


def test_some_of_the_images_see_what_they_saw() -> None:
    images = mapped(ring(5), floor_points(9), some_similarity())
    some = images.only({images.names[1], images.names[4]})
    assert some.names == (images.names[1], images.names[4])
    np.testing.assert_array_equal(some.T_world_camera, images.T_world_camera[[1, 4]])
    np.testing.assert_array_equal(some.rays(1, np.array([[10.0, 20.0]])), images.rays(4, np.array([[10.0, 20.0]])))
    assert {tuple(row) for row in some.seen.tolist()} == {(v, p) for v in (0, 1) for p in range(len(images.points))}
