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
    "both": shapes.joined([shapes.gem(0.1), shapes.moved(shapes.pin(1.0), 1.0, 2.0, 3.0)]),
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
