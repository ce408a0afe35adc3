from collections.abc import Callable

import numpy as np
import pytest

from readygo.apps.monitor import shapes

MESHES = {
    "human": shapes.human(),
    "robot": shapes.robot(0.25, 0.6),
    "flat robot": shapes.robot(0.4, 0.1),
    "band": shapes.band(0.25, 0.3, 0.4),
    "disc": shapes.disc(0.3, 0.2),
    "fan": shapes.fan(1.7, 3.0, 0.3),
    "gem": shapes.gem(0.05),
    "pin": shapes.pin(0.8),
    "both": shapes.join_meshes([shapes.gem(0.1), shapes.move_mesh(shapes.pin(1.0), 1.0, 2.0, 3.0)]),
}


@pytest.mark.parametrize("name", MESHES)
def test_faces_name_points_that_are_there(name: str) -> None:
    mesh = MESHES[name]
    assert np.isfinite(mesh.vertices_m).all()
    assert set(np.unique(mesh.faces)) == set(range(len(mesh.vertices_m)))


def test_bodies_stand_on_the_floor_and_are_as_large_as_said() -> None:
    robot = MESHES["robot"].vertices_m
    assert robot[:, 2].max() == pytest.approx(0.6)
    assert np.linalg.norm(robot[:, :2], axis=1).max() == pytest.approx(0.25)
    assert MESHES["human"].vertices_m[:, 2].min() == pytest.approx(0.0, abs=0.01)
    fan = MESHES["fan"].vertices_m
    assert np.abs(np.arctan2(fan[:, 1], fan[:, 0])).max() == pytest.approx(0.85)


def test_segments_have_a_length_and_are_lifted() -> None:
    way = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.001, 0.0, 0.0], [2.0, 0.0, 0.0]])
    segments = shapes.segments(way, 0.1)
    assert segments.shape == (2, 2, 3)
    assert segments[:, :, 2].tolist() == [[pytest.approx(0.1)] * 2] * 2
    assert len(shapes.segments(way[:2])) == 0


def test_arrow_ends_where_it_points_with_a_head_and_short_ones_are_left_out() -> None:
    arrow = shapes.arrow_segments((1.0, 2.0), (1.0, 3.0), 0.1)
    assert arrow.shape == (3, 2, 3)
    np.testing.assert_allclose(arrow[:, 1], [[1.0, 3.0, 0.1]] * 3, rtol=1e-6)
    np.testing.assert_allclose(arrow[0, 0], [1.0, 2.0, 0.1], rtol=1e-6)
    np.testing.assert_allclose(arrow[1, 0, 0] + arrow[2, 0, 0], 2.0, rtol=1e-6)
    assert len(shapes.arrow_segments((1.0, 2.0), (1.0, 2.1), 0.1)) == 0


def test_straight_drums_and_rings_have_their_volume_and_area() -> None:
    corners = 28
    drum = shapes.lathe([(0.0, 0.2), (0.3, 0.2), (0.3, 0.9), (0.0, 0.9)])
    polygon_m2 = corners / 2 * 0.3**2 * np.sin(2 * np.pi / corners)
    assert volume_m3(drum) == pytest.approx(polygon_m2 * 0.7, rel=1e-5)
    side_m2 = corners * 2 * 0.3 * np.sin(np.pi / corners) * 0.7
    assert area_m2(drum) == pytest.approx(2 * polygon_m2 + side_m2, rel=1e-5)
    ring = shapes.disc(0.34, 0.27)
    assert area_m2(ring) == pytest.approx(48 / 2 * (0.34**2 - 0.27**2) * np.sin(2 * np.pi / 48), rel=1e-5)
    fan = shapes.fan(1.7, 3.0, 0.3)
    assert area_m2(fan) == pytest.approx(24 / 2 * (3.0**2 - 0.3**2) * np.sin(1.7 / 24), rel=1e-5)
    limb = shapes.capsule((0.3, -0.2, 1.4), (-0.1, 0.25, 0.9), 0.05, 0.04)
    points, begin, end = limb.vertices_m.astype(float), np.array([0.3, -0.2, 1.4]), np.array([-0.1, 0.25, 0.9])
    along = (end - begin) / np.linalg.norm(end - begin)
    reach = (points - begin) @ along
    assert (reach.min(), reach.max()) == pytest.approx((-0.05, np.linalg.norm(end - begin) + 0.04), abs=1e-5)
    away = np.linalg.norm(np.cross(points - begin, along), axis=1)
    assert away[reach < 0.03].max() == pytest.approx(0.05, abs=1e-5)
    assert away[reach > reach.max() - 0.05].max() == pytest.approx(0.04, abs=1e-5)


def area_m2(mesh: shapes.ViewerMesh) -> float:
    a, b, c = mesh.vertices_m.astype(float)[mesh.faces].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def volume_m3(mesh: shapes.ViewerMesh) -> float:
    """Positive where faces look outwards."""
    a, b, c = mesh.vertices_m.astype(float)[mesh.faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def test_bodies_look_as_they_did(golden_page: Callable[[str, str], None]) -> None:
    lines = []
    for name, mesh in MESHES.items():
        low, high, mean = (f(mesh.vertices_m, axis=0) for f in (np.min, np.max, np.mean))
        numbers = [*low, *high, *mean, area_m2(mesh), volume_m3(mesh)]
        lines.append(f"{name}: {mesh.vertices_m.shape} {' '.join(f'{value + 0.0:.3f}' for value in numbers)}")
    golden_page("monitor_shapes", "\n".join(lines).replace("-0.000", "0.000"))
