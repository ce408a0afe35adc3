import numpy as np
import pytest

from readygo.common.messages import CommittedEpisode, EpisodeHeader, EpisodeKey, Sample, Split
from readygo.common.messages.plan import Driver, Outcome
from readygo.services.trainer.episodes import committed_episode, nearest_humans, read_episodes


def sample(seq, **fields):
    numbers = {
        "seq": seq,
        "crc32": 0,
        "time_ns": seq,
        "image": bytes([seq]),
        "action_v_mps": 0.5,
        "action_w_radps": 0.1 * seq,
        "goal_xy_robot_m": (3.0, 1.0),
        "robot_xyzyaw": (1.0, 2.0, 9.0, 0.0),
        "humans_xyzyaw": ((3.0, 2.0, 0.0, 0.0), (1.0, 3.0, 0.0, 0.0)),
        "human_distance_m": 1.0,
        "time_to_collision_s": 9.0,
        "human_visible": seq > 0,
        "expert_cost": 0.0,
        "replanned": False,
        "expert_commands": ((0.4, 0.0), (0.6, 0.2)),
    }
    return Sample(**(numbers | fields))


def message(samples, **fields):
    header = {
        "episode": EpisodeKey(seed=0, split=Split.TRAIN, index=7),
        "sample_count": len(samples),
        "goal_xy_m": (0.0, 0.0),
        "start_xyyaw": (0.0, 0.0, 0.0),
        "avatars": ("a", "b"),
        "encounters": ("x", "y"),
        "image_format": "jpeg",
        "height_px": 8,
        "width_px": 8,
        "K_px": (1.0,) * 9,
        "outcome": Outcome.HUMAN_COLLISION,
        "driver": Driver.POLICY,
        "policy": "ab" * 32,
    }
    return CommittedEpisode(header=EpisodeHeader(**(header | fields)), attempt=1, samples=tuple(samples))


def test_committed_episode_keeps_what_training_needs():
    episode = committed_episode(message([sample(k) for k in range(3)]))
    assert episode.images == (b"\0", b"\1", b"\2")
    assert np.allclose(episode.actions[:, 1], [0, 0.1, 0.2])
    assert episode.xyyaw[0].tolist() == [1, 2, 0]
    assert episode.expert.shape == (3, 2, 2)
    assert (episode.driver, episode.outcome, episode.static) == (Driver.POLICY, Outcome.HUMAN_COLLISION, False)
    assert episode.policy == "ab" * 32


def test_episode_of_which_the_expert_was_not_asked_everywhere_has_no_advice():
    assert committed_episode(message([sample(0), sample(1, expert_commands=())])).expert is None


def test_nearest_human_is_the_nearest_one_ahead_where_one_is_visible():
    episode = committed_episode(message([sample(0), sample(1)]))
    assert episode.humans[0].tolist() == [0, 0, 0]
    assert episode.humans[1].tolist() == [1, 0, 2]


def test_bearing_is_to_the_left_of_where_the_robot_looks():
    places = [np.array([[0.0, 2.0]])]
    found = nearest_humans(np.array([[0.0, 0.0, np.pi / 4]]), places, np.array([True]))
    assert found[0] == pytest.approx([1, np.pi / 4, 2])


def test_recorded_episodes_come_with_the_advice_that_the_data_have(source):
    plain = list(read_episodes(source))
    assert [episode.name for episode in plain] == [entry.sha256 for entry in source.episodes]
    assert plain[0].expert is None
    assert plain[0].static
    source.has_expert = True
    advised = list(read_episodes(source))[1]
    assert np.array_equal(advised.expert[:, 0], source.actions[60:120])
    assert np.array_equal(advised.expert[3, 2], source.actions[65])
    assert advised.images[4] == source.image(64)
    assert advised.humans is None
    seen = next(read_episodes(source, with_humans=True)).humans
    assert np.allclose(seen, [1, 0, 2], atol=1e-5)
    assert advised.size_bytes > plain[1].size_bytes
