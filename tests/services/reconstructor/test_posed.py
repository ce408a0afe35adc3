import numpy as np

from tests.services.reconstructor.synthetic import floor_points, mapped, ring, some_similarity


def test_moved_map_sees_the_same() -> None:
    images = mapped(ring(3), floor_points(9), some_similarity())
    moved = images.moved(some_similarity())

    def seen(which: object) -> np.ndarray:
        T = which.T_world_camera[1]
        xyz = (which.points - T[:3, 3]) @ T[:3, :3]
        return xyz[:, :2] / xyz[:, 2:]

    np.testing.assert_allclose(seen(moved), seen(images), atol=1e-12)
    assert moved.names == images.names
