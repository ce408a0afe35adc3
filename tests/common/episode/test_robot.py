from readygo.common.episode.robot import drawn_of_episode, robot_of_episode
from readygo.common.messages import EpisodeKey, Split
from readygo.common.robot import RobotConfig
from readygo.common.robot.ranges import RobotRanges

KEYS = [EpisodeKey(seed=3, split=Split.TRAIN, index=index) for index in range(5)]


def test_every_episode_has_its_own_robot_and_has_it_again() -> None:
    robot = RobotConfig(ranges=RobotRanges(w_max_radps=(0.5, 1.5), mount_pitch_deg=(-5.0, 5.0)))
    robots = [robot_of_episode(robot, key) for key in KEYS]
    assert len({one.w_max_radps for one in robots}) == len(KEYS)
    assert all(0.5 <= one.w_max_radps <= 1.5 and abs(one.camera.mount_pitch_deg) <= 5.0 for one in robots)
    assert robots == [robot.with_values(drawn_of_episode(robot, key)) for key in KEYS]
    assert not any(one.ranges.varies for one in robots)


def test_robot_without_ranges_is_the_same_in_every_episode() -> None:
    robot = RobotConfig()
    assert drawn_of_episode(robot, KEYS[0]) == {}
    assert all(robot_of_episode(robot, key) is robot for key in KEYS)
