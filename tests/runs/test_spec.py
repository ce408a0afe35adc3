import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.errors import RunError
from readygo.common.messages import Split
from readygo.runs.config import RunConfig
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec


@pytest.mark.parametrize("seed", [-1, 2**63])
def test_seed_that_cannot_be_recorded_is_refused(seed: int) -> None:
    with pytest.raises(RunError, match="--seed must be"):
        make_spec(open_scene("embedded"), None, RunConfig(), seed=seed, split=Split.TRAIN, static=True)


def test_goals_that_the_scene_has_no_room_for_are_refused_before_anything_runs() -> None:
    config = RunConfig(episode=EpisodeConfig(goal_distance_min_m=30.0, goal_distance_max_m=40.0))
    with pytest.raises(RunError, match=r"no episode has room: goals are 30 m away at least"):
        make_spec(open_scene("embedded"), None, config, seed=0, split=Split.TRAIN, static=True)
