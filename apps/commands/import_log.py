"""`readygo import rosbag2` and `readygo import mcap`: convert a real robot's log to a data folder."""

from dataclasses import dataclass
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from tyro.conf import Positional

from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.robot_logs.convert import LogTopics, convert
from readygo.apps.terminal import PlainConsole
from readygo.common.robot import RobotConfig, load_robot


@dataclass(frozen=True, kw_only=True)
class ImportLogOptions:
    """Convert a ROS 2 log of a manually driven robot to a data folder; needs no ROS.

    Times are those of the recording. An episode ends after a gap of 0.5 s in images or odometry, after the robot has
    stood still for 2 s, or after `episode_s`; its goal is its last position. The recorded commands are those with which
    this robot follows the odometry. Pedestrians in the images are not labelled.
    """

    log: Positional[Path]
    """Folder of a rosbag2, or an MCAP file with ROS 2 messages."""
    out: Path
    """Data folder to make."""
    image: str = "/camera/image_raw"
    """Topic of the images, Image or CompressedImage."""
    odom: str = "/odom"
    """Topic of the Odometry."""
    camera_info: str = ""
    """Topic of the CameraInfo; by default the camera of `robot` is used."""
    robot: Path | None = None
    """robot.toml of the robot: its limits, and the mounting of its camera."""
    episode_s: float = 30.0
    """Longest episode [s]."""
    license: str = ""
    """License of the log; recorded in everything made from it."""


def import_log(options: ImportLogOptions) -> None:
    """Convert a ROS 2 log of a manually driven robot to a data folder; needs no ROS."""
    topics = LogTopics(image=options.image, odometry=options.odom, camera_info=options.camera_info)
    with SteadyProgress(TextColumn("importing"), BarColumn(), MofNCompleteColumn(), transient=True) as progress:
        task = progress.add_task("importing", total=None)
        found = convert(
            options.log,
            options.out,
            topics,
            load_robot(options.robot) if options.robot is not None else RobotConfig(),
            episode_s=options.episode_s,
            license=options.license,
            progress=lambda done, total: progress.update(task, completed=done, total=total),
        )
    words = (
        f"{options.out}: {found.episodes} episodes, {found.samples:,} samples, "
        f"at most {found.drift_m:.2f} m off the odometry"
    )
    PlainConsole(soft_wrap=True).print(words, markup=False)
