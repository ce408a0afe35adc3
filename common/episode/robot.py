"""Which robot drives in an episode."""

from readygo.common.episode.streams import Purpose, episode_rng
from readygo.common.messages.episode import EpisodeKey
from readygo.common.robot.config import RobotConfig


def drawn_of_episode(robot: RobotConfig, episode: EpisodeKey) -> dict[str, float]:
    """What an episode draws from a robot's ranges, by the names of `RobotRanges`; nothing without ranges."""
    return robot.ranges.drawn_values(episode_rng(episode, Purpose.ROBOT)) if robot.ranges.varies else {}


def robot_of_episode(robot: RobotConfig, episode: EpisodeKey) -> RobotConfig:
    """The robot of an episode: with a value from each range, or the robot itself if it has none."""
    return robot.with_values(drawn_of_episode(robot, episode))
