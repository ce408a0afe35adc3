"""What the cameras of an episode's robot are, as its shard tells."""

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.episode.robot import robot_of_episode
from readygo.common.messages import EpisodeKey, FurtherCamera
from readygo.common.robot import RobotConfig
from readygo.services.renderer.sensor.streams import SensorStream


def calibrations(robot: RobotConfig, sensor: SensorConfig, episode: EpisodeKey) -> tuple[FurtherCamera, ...]:
    """What is constant of a robot's cameras over an episode, the first one, called "", before the others.

    Args:
        robot: Of the run, with its ranges.
        sensor: What varies of its cameras from episode to episode.
        episode: Which one.
    """
    driven, stream = robot_of_episode(robot, episode), SensorStream.of_episode(episode)
    cameras = {"": driven.camera, **driven.cameras}
    return tuple(
        _described(name, sensor.drawn(camera, stream.of_camera(name).of_draws())) for name, camera in cameras.items()
    )


def _described(name: str, camera: CameraConfig) -> FurtherCamera:
    return FurtherCamera(
        name=name,
        height_px=camera.height_px,
        width_px=camera.width_px,
        K_px=tuple(camera.K_px.ravel().tolist()),
        distortion_model=camera.distortion_model,
        distortion=camera.coefficients,
    )
