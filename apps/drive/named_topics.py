"""Topics of a robot's images from arguments: /topic for its first camera, NAME=/topic for another one."""

from collections.abc import Iterable, Mapping, Sequence

from readygo.common.errors import ConfigError
from readygo.common.images.names import DEPTH, RGB, camera_of, cameras_of, image_name, kind_of
from readygo.common.robot import RobotConfig

DEFAULT_IMAGE = "/camera/image_raw"
_OPTIONS: Mapping[str, str] = {RGB: "--image", DEPTH: "--depth"}


def image_topics(
    image: Sequence[str], depth: Sequence[str], robot: RobotConfig, *, every_camera: bool = False
) -> dict[str, str]:
    """Topics by the names of the images on them (`readygo.common.images.names`), the first camera's rgb first.

    Args:
        image: Arguments for colour images; the first camera's topic is `DEFAULT_IMAGE` without one.
        depth: Arguments for depth images.
        robot: Robot with the cameras.
        every_camera: True also adds each camera without an argument, with the topic /NAME/image_raw.

    Raises:
        ConfigError: If there is no such camera, an image has two topics, or a topic has two images.
    """
    topics = {RGB: DEFAULT_IMAGE}
    if every_camera:
        topics |= {image_name(camera, RGB): f"/{camera}/image_raw" for camera in robot.cameras}
    given: set[str] = set()
    for kind, entries in ((RGB, image), (DEPTH, depth)):
        for entry in entries:
            camera, _, topic = entry.rpartition("=")
            if not topic.strip("/") or entry in robot.all_cameras:
                name = camera or (entry if entry in robot.all_cameras else robot.camera_name)
                raise ConfigError(f"{_OPTIONS[kind]} {entry!r} names no topic: {name}=/{name}/image_raw is one.")
            if camera and camera not in robot.all_cameras:
                raise ConfigError(
                    f"{_OPTIONS[kind]} {entry}: there is no camera {camera!r}; there are "
                    f"{', '.join(robot.all_cameras)}."
                )
            name = image_name("" if camera == robot.camera_name else camera, kind)
            if name in given:
                raise ConfigError(f"{_OPTIONS[kind]} names two topics of one camera: {topics[name]} and {topic}.")
            given.add(name)
            topics[name] = topic
    if len(set(topics.values())) < len(topics):
        raise ConfigError(f"Each image needs a different topic, got {', '.join(topics.values())}.")
    return topics


def check_topics(topics: Mapping[str, str], wanted: Iterable[str], robot: RobotConfig) -> None:
    """Raise ConfigError unless there are topics for exactly the images that the policy uses."""
    wanted = tuple(wanted)
    for name in wanted:
        if name not in topics:
            raise ConfigError(
                f"The policy sees {_words(name, robot)}: name the topic with {_OPTIONS[kind_of(name)]} "
                f"{f'{camera_of(name)}=' if camera_of(name) else ''}/{camera_of(name) or 'camera'}/"
                f"{'image_raw' if kind_of(name) == RGB else 'depth/image_raw'}."
            )
    for name in topics:
        if name not in wanted:
            raise ConfigError(f"The policy does not see {_words(name, robot)}: leave {topics[name]} out.")


def info_topics(topics: Mapping[str, str]) -> dict[str, str]:
    """CameraInfo topic of each camera by name, in the namespace of its image topic."""
    return {camera: _beside(topics[image_name(camera, RGB)]) for camera in cameras_of(topics)}


def check_infos(infos: Mapping[str, str]) -> None:
    """Raise ConfigError if cameras share a CameraInfo topic; `infos` are the topics by the cameras' names."""
    for camera, topic in infos.items():
        sharing = [other for other, of_other in infos.items() if of_other == topic]
        if camera != sharing[0]:
            raise ConfigError(
                f"Each camera needs a different CameraInfo topic, and those of {sharing[0] or 'the first camera'} and "
                f"{camera} are both {topic}, beside their images: describe the cameras with --calibration robot.toml."
            )


def _beside(image: str) -> str:
    return f"{image.removesuffix('/compressed').rpartition('/')[0]}/camera_info"


def _words(name: str, robot: RobotConfig) -> str:
    what = "images" if kind_of(name) == RGB else "depths"
    return f"{what} of the camera {camera_of(name) or robot.camera_name!r}" if robot.cameras else what
