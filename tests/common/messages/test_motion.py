import numpy as np
import pytest

from readygo.common.messages import Motion


def motion(root_rows: int, pose_rows: int, joints: int = 24) -> Motion:
    root_m, pose = np.zeros((root_rows, 3), np.float32), np.zeros((pose_rows, joints, 3), np.float32)
    return Motion(root_m=root_m, pose_axis_angle=pose)


def test_last_row_is_held() -> None:
    assert [motion(5, 5).row(step) for step in (0, 3, 4, 5, 100)] == [0, 3, 4, 4, 4]


@pytest.mark.parametrize(
    ("rows", "message"),
    [((5, 4), "pose_axis_angle"), ((5, 5, 22), "pose_axis_angle"), ((0, 0), "at least one row")],
)
def test_motion_that_is_not_whole_is_refused(rows: tuple[int, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        motion(*rows)
