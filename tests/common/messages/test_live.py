import numpy as np
import pytest

from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.common.messages.live import LivePlan

EPISODE = EpisodeKey(seed=0, split=Split.TRAIN, index=0)


def test_plan_has_a_flag_for_every_pose() -> None:
    way = np.zeros((3, 3), np.float32)
    with pytest.raises(ValueError, match="replanned"):
        LivePlan(
            episode=EPISODE,
            outcome=Outcome.SUCCESS,
            goal_xy_m=(0.0, 0.0),
            robot_xyyaw=way,
            replanned=np.zeros(2, np.bool_),
            humans_xy_m=(),
        )
