"""`readygo import rosbag2` and `readygo import mcap`: convert a real robot's log to a data folder."""

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
    """Convert a ROS 2 log of a manually driven robot to a data folder; needs no ROS.

    Times are those of the recording. An episode ends after a gap of 0.5 s in images or odometry, after the robot has
    stood still for 2 s, or after `episode_s`; its goal is its last position. The recorded commands are those with which
    this robot follows the odometry. Pedestrians in the images are not labelled.

    Args:
        log: Folder of a rosbag2, or an MCAP file with ROS 2 messages.
        out: Data folder to make.
        image: Topic of the images, Image or CompressedImage.
        odom: Topic of the Odometry.
        camera_info: Topic of the CameraInfo; by default the camera of `robot` is used.
        robot: robot.toml of the robot: its limits, and the mounting of its camera.
        episode_s: Longest episode [s].
        license: License of the log; recorded in everything made from it.

    Raises:
        ConfigError: If a topic is missing, or rosbags is not installed.
        DatasetError: If the log cannot be read, or holds no usable data.
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
