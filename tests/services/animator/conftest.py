import numpy as np
import pytest

from readygo.services.animator import walk
from readygo.services.animator.gait.human import skeleton_of
from tests.services.animator.bodies import make_avatar


@pytest.fixture(scope="session")
def avatar():
    return make_avatar()


@pytest.fixture(scope="session")
def animate(avatar):
    """Walk a trajectory with the test avatar, or another, without style unless asked."""

    def run(xy, floor, *, body=avatar, seed=0, style=0.0):
        return walk(skeleton_of(body), xy, floor, np.random.default_rng(seed), style)

    return run
