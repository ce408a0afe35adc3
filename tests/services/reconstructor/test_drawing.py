import numpy as np

from readygo.common.drawing.plan_view import HUMANS, ROBOT
from readygo.services.reconstructor.drawing import draw_map
from readygo.services.reconstructor.similarity import Similarity
from tests.services.reconstructor.synthetic import floor_points, mapped, marker_at, ring


def test_cameras_points_and_markers_are_drawn() -> None:
    images = mapped(ring(), floor_points(), Similarity(scale=1.0, R=np.eye(3), t=np.zeros(3)))
    picture = draw_map(images, {4: marker_at()})
    assert 800 < max(picture.shape[:2]) <= 1000
    for colour in (ROBOT, HUMANS[0], (120, 120, 120)):
        assert (picture == colour).all(axis=2).sum() > 20
    assert (draw_map(images, {}) == HUMANS[0]).all(axis=2).sum() == 0
