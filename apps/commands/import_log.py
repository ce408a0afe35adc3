"""`readygo import rosbag2` and `readygo import mcap`: a robot that somebody drove becomes a data folder."""

from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn

from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.robot_logs.convert import LogTopics, convert
from readygo.apps.terminal import PlainConsole
from readygo.common.robot import RobotConfig, load_robot


def import_log(
    log: Path,
    /,
    *,
    out: Path,
    image: str = "/camera/image_raw",
    odom: str = "/odom",
    camera_info: str = "",
    robot: Path | None = None,
    episode_s: float = 30.0,
    license: str = "",
) -> None:
    """Make a data folder of a ROS 2 log of a robot that somebody drove; no ROS is needed.

    Times are those of the recording. An episode ends where images or odometry are missing for 0.5 s, where the robot
    stands for 2 s, and after `episode_s`; its goal is where it ends. The recorded commands are those with which this
    robot follows the odometry. Nobody is marked in the images: humans in them are not known.

    Args:
        log: Folder of a rosbag2, or an MCAP file with ROS 2 messages.
        out: Data folder to make.
        image: Topic of the images, Image or CompressedImage.
        odom: Topic of the Odometry.
        camera_info: Topic of the CameraInfo; by default the camera is that of the robot.
        robot: robot.toml of the robot: its limits, and how its camera is mounted.
        episode_s: Longest episode [s].
        license: Terms of the log; recorded with everything made from it.

    Raises:
        ConfigError: If a topic is missing, or rosbags is not installed.
        DatasetError: If the log cannot be read, or holds nothing that can be used.
    """
    topics = LogTopics(image=image, odometry=odom, camera_info=camera_info)
    with SteadyProgress(TextColumn("importing"), BarColumn(), MofNCompleteColumn(), transient=True) as progress:
        task = progress.add_task("importing", total=None)
        found = convert(
            log,
            out,
            topics,
            load_robot(robot) if robot is not None else RobotConfig(),
            episode_s=episode_s,
            license=license,
            progress=lambda done, total: progress.update(task, completed=done, total=total),
        )
    words = (
        f"{out}: {found.episodes} episodes, {found.samples:,} samples, at most {found.drift_m:.2f} m off the odometry"
    )
    PlainConsole(soft_wrap=True).print(words, markup=False)
