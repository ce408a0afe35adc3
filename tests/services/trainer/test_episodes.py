import dataclasses

import numpy as np
import pytest

from readygo.common.dataset import Dataset
from readygo.common.errors import DatasetError
from readygo.common.messages import CommittedEpisode, EpisodeHeader, EpisodeKey, Sample, Split
from readygo.common.messages.plan import DriverKind, Outcome
from readygo.common.robot import RobotConfig
from readygo.common.robot.command_grid import UNKNOWN_RISK
from readygo.services.trainer.episodes import committed_episode, nearest_humans, read_episodes
from tests import crooked

ROBOT = RobotConfig()


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
        "driver": DriverKind.POLICY,
        "policy": "ab" * 32,
    }
    return CommittedEpisode(header=EpisodeHeader(**(header | fields)), attempt=1, samples=tuple(samples))


def test_committed_episode_keeps_what_training_needs():
    episode = committed_episode(message([sample(k) for k in range(3)]), ROBOT)
    assert episode.images == (b"\0", b"\1", b"\2")
    assert np.allclose(episode.actions[:, 1], [0, 0.1, 0.2])
    assert episode.xyyaw[0].tolist() == [1, 2, 0]
    assert episode.expert.shape == (3, 2, 2)
    assert (episode.driver, episode.outcome, episode.static) == (DriverKind.POLICY, Outcome.HUMAN_COLLISION, False)
    assert episode.policy == "ab" * 32


def test_episode_of_which_the_expert_was_not_asked_everywhere_has_no_advice():
    assert committed_episode(message([sample(0), sample(1, expert_commands=())]), ROBOT).expert is None


def test_nearest_human_is_the_nearest_one_in_view_where_one_is_visible():
    episode = committed_episode(message([sample(0), sample(1)]), ROBOT)
    assert episode.humans[0].tolist() == [0, 0, 0]
    assert episode.humans[1].tolist() == [1, 0, 2]


def test_bearing_is_to_the_left_of_where_the_robot_looks():
    places = [np.array([[0.0, 2.0]])]
    found = nearest_humans(np.array([[0.0, 0.0, np.pi / 4]]), places, np.array([True]), ROBOT)
    assert found[0] == pytest.approx([1, np.pi / 4, 2])


def at_bearings(*bearings_deg, distances_m, robot):
    """The nearest human of some around a robot that stands askew."""
    angles = np.radians(bearings_deg) + 0.7
    places = np.array([3.0, -1.0]) + np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.array(distances_m)[:, None]
    return nearest_humans(np.array([[3.0, -1.0, 0.7]]), [places], np.array([True]), robot)[0].tolist()


def test_human_beside_the_robot_whom_no_camera_shows_is_not_the_nearest():
    ahead = pytest.approx([1, np.radians(-20), 3], abs=1e-6)
    assert at_bearings(80, -20, distances_m=(1.2, 3), robot=ROBOT) == ahead
    # An arm reaches into the image.
    assert at_bearings(58, -20, distances_m=(1.2, 3), robot=ROBOT)[2] == pytest.approx(1.2)
    left = dataclasses.replace(ROBOT.camera, mount_yaw_deg=90.0)
    both = dataclasses.replace(ROBOT, cameras={"left": left})
    assert at_bearings(80, -20, distances_m=(1.2, 3), robot=both)[2] == pytest.approx(1.2)
    assert at_bearings(-80, -20, distances_m=(1.2, 3), robot=both) == ahead
    rear = dataclasses.replace(ROBOT, camera=dataclasses.replace(left, mount_yaw_deg=180.0))
    assert at_bearings(170, -20, distances_m=(4, 3), robot=rear) == pytest.approx([1, np.radians(170), 4], abs=1e-6)


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


@pytest.mark.parametrize("robot", [crooked.ROBOT, crooked.ODD_RATES], ids=["20 Hz", "30 Hz"])
def test_episode_is_the_same_from_its_shard_and_from_its_announcement(tmp_path, robot):
    crooked.write_crooked_shard(tmp_path, (3, 8), 15, robot=robot)
    names = ("depth", "left.rgb")
    read = list(read_episodes(Dataset(tmp_path), with_humans=True, outputs=names))
    assert len(read) == 2
    for index, recorded in zip((3, 8), read, strict=True):
        header, samples = crooked.crooked_episode(index, 15, robot=robot)
        told = committed_episode(CommittedEpisode(header=header, attempt=1, samples=samples), robot, names)
        for name in ("images", "outputs", "driver", "outcome", "static", "policy", "drawn"):
            assert getattr(recorded, name) == getattr(told, name), name
        for name in ("actions", "goals_xy_m", "xyyaw", "expert", "risks", "humans"):
            np.testing.assert_allclose(getattr(recorded, name), getattr(told, name), atol=1e-6, err_msg=name)
        assert told.name == header.episode.episode_id
        for row, one in enumerate(samples):
            assert told.pictured[row] == bool(one.image)
            assert told.xyyaw[row].tolist() == [one.robot_xyzyaw[0], one.robot_xyzyaw[1], one.robot_xyzyaw[3]]
            if one.image:
                np.testing.assert_allclose(told.expert[row], one.expert_commands, atol=1e-6)
                assert told.risks[row].tobytes() == one.risks
            else:
                assert np.isnan(told.expert[row]).all()
                assert (told.risks[row] == UNKNOWN_RISK).all()


def test_humans_behind_are_not_the_nearest_and_bearings_stay_within_half_a_turn():
    places = np.array([[-3.2 - 1.0, 7.1 + 0.9], [-3.2 + 0.4, 7.1 - 0.5], [-3.2 - 0.2, 7.1 + 2.4]])
    pose = np.array([[-3.2, 7.1, 2.5 + 2 * np.pi]])
    (found,) = nearest_humans(pose, [places], np.array([True]), ROBOT)
    assert found.tolist() == pytest.approx([1, np.arctan2(0.9, -1.0) - 2.5, np.hypot(1.0, 0.9)], abs=1e-6)
    assert nearest_humans(pose, [places[1:2]], np.array([True]), ROBOT).tolist() == [[0, 0, 0]]
    assert nearest_humans(pose, [places[:0]], np.array([True]), ROBOT).tolist() == [[0, 0, 0]]


def test_size_is_that_of_all_files_and_numbers():
    episode = committed_episode(
        message([sample(k, image=bytes(100), outputs={"depth": bytes(40)}) for k in range(3)]), ROBOT
    )
    seen = dataclasses.replace(episode, outputs={"depth": (bytes(40),) * 3})
    numbers = (episode.actions, episode.goals_xy_m, episode.xyyaw, episode.expert, episode.humans)
    assert episode.size_bytes == 300 + sum(array.nbytes for array in numbers)
    assert seen.size_bytes == episode.size_bytes + 120


def test_image_that_the_policy_shall_see_must_be_there():
    with pytest.raises(DatasetError, match="no 'depth' images"):
        committed_episode(message([sample(0)]), ROBOT, ("depth",))
    with_goal = [sample(0, outputs={"goal_image": b"goal"}), sample(1)]
    assert committed_episode(message(with_goal), ROBOT, ("goal_image",)).outputs == {"goal_image": (b"goal", b"")}


def test_risks_are_known_where_all_were_looked_at():
    def risks(*rows):
        return committed_episode(message([sample(k, risks=row) for k, row in enumerate(rows)]), ROBOT).risks

    assert risks(b"\1\2", b"\0\1").tolist() == [[1, 2], [0, 1]]
    assert risks(b"\1\2", b"") is None
    assert risks(b"", b"") is None
