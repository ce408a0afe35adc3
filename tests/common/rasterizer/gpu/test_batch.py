import numpy as np
import pytest

pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.rasterizer.gpu.batch import make_batch
from tests.common.rasterizer.drawing import batch_of

POSES = np.tile(np.eye(4), (2, 1, 1))


def test_cameras_may_see_different_numbers_of_humans(human) -> None:
    views = batch_of(POSES, [[], [human(1.0, 2.0), human(3.0, 4.0, avatar=1)]])
    batch = make_batch(views, {"0": 0, "1": 1}, "cpu")
    assert batch.avatar.tolist() == [[-1, -1], [0, 1]]
    assert batch.root_m[1, 1].tolist() == [3.0, 4.0, 1.0]
    assert batch.part(1, 2).avatar.tolist() == [[0, 1]]


def test_cameras_need_not_see_anybody() -> None:
    batch = make_batch(batch_of(POSES, [[], []]), {}, "cpu")
    assert batch.T_world_camera.shape == (2, 4, 4)
    assert batch.avatar.shape == (2, 0)
