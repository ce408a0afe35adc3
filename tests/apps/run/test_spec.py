import pytest

from readygo.apps.run.config import RunConfig
from readygo.apps.run.scene_argument import open_scene
from readygo.apps.run.spec import make_spec
from readygo.common.errors import RunError
from readygo.common.messages import Split


@pytest.mark.parametrize("seed", [-1, 2**63])
def test_seed_that_cannot_be_recorded_is_refused(seed: int) -> None:
    with pytest.raises(RunError, match="--seed must be"):
        make_spec(open_scene("embedded"), None, RunConfig(), seed=seed, split=Split.TRAIN, static=True)
