"""Rectification of the robot's images to the policy's camera: lens, size, field of view, yaw and pitch."""

import math
from pathlib import Path

import cv2
import numpy as np

from readygo.apps.robot_logs.convert import camera_of
from readygo.apps.robot_logs.reader import LogCamera
from readygo.common.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from readygo.common.camera import CameraConfig
from readygo.common.camera.lens import make_lens
from readygo.common.errors import ConfigError
from readygo.common.robot import RobotConfig, load_robot

UNSEEN_MAX = 0.1
"""Largest share of the policy's image that the robot's camera may fail to show."""
MOUNT_MAX_M = 0.05
"""Largest difference of the mounts that rectification can ignore [m]."""
_SAMPLES_MAX = 6
"""Largest number of samples of the robot's image along each side of a pixel of the policy's."""


class Rectifier:
    """Converts the robot's images to those of the policy's camera at the same place."""

    def __init__(self, robot: CameraConfig, policy: CameraConfig) -> None:
        """Compute the pixels of the robot's image that each pixel of the policy's image shows.

        Args:
            robot: The robot's camera.
            policy: The camera that the policy was trained with.

        Raises:
            ConfigError: If the robot's image covers too little of the policy's image.
        """
        self._size = (robot.height_px, robot.width_px)
        self._policy_size = (policy.width_px, policy.height_px)
        count = min(max(math.ceil(float(robot.K_px[0, 0] / policy.K_px[0, 0])), 1), _SAMPLES_MAX)
        uv, _ = _places(robot, policy, count)
        inside = inside_of(uv, robot)
        self.unseen = float(1.0 - inside.mean())
        """Share of the policy's image that the robot's camera does not show; it is black."""
        if self.unseen > UNSEEN_MAX:
            raise ConfigError(
                f"The robot's camera does not show {100 * self.unseen:.0f} % of what the policy's shows (at most "
                f"{100 * UNSEEN_MAX:.0f} %): mount a wider lens, or train a policy with this camera in robot.toml."
            )
        # Pixel centres are at integers in OpenCV.
        u, v = (np.where(inside, uv[..., axis] - 0.5, -9.0).astype(np.float32) for axis in (0, 1))
        self._maps = cv2.convertMaps(u, v, cv2.CV_16SC2)
        self.identity = (
            self._size == self._policy_size[::-1] and count == 1 and bool(np.abs(uv - _centres(policy, 1)).max() < 0.01)
        )
        """True if the cameras are equal: images pass unchanged."""
        nearest, ahead = _places(robot, policy, 1)
        u, v = np.where(inside_of(nearest, robot), np.floor(nearest.transpose(2, 0, 1)), -9.0).astype(np.float32)
        self._nearest, self._ahead = (u, v), ahead.astype(np.float32)

    def __call__(self, bgr: UInt8Array) -> UInt8Array:
        """An image of the policy's camera.

        Args:
            bgr: The robot's image: blue, green, red, shape (H, W, 3).

        Returns:
            sRGB, shape (H, W, 3) of the policy's camera.

        Raises:
            ValueError: If the image's size differs from the robot's camera, or it holds depths.
        """
        if bgr.ndim != 3:
            raise ValueError("depths where colours are due: name the topic of the camera's colours with --image")
        if bgr.shape[:2] != self._size:
            raise ValueError(
                f"images of {bgr.shape[0]}x{bgr.shape[1]} px, and its calibration is of {self._size[0]}x{self._size[1]}"
            )
        if not self.identity:
            first, second = self._maps
            large = cv2.remap(bgr, first, second, cv2.INTER_LINEAR)
            bgr = cv2.resize(large, self._policy_size, interpolation=cv2.INTER_AREA).astype(np.uint8)
        return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)

    def depth(self, depth_m: Float32Array) -> Float32Array:
        """Depths that the policy's camera would have measured.

        Args:
            depth_m: The robot's, aligned to its images: depths along the optical axis [m], inf where nothing is
                measured, shape (H, W).

        Returns:
            Depths along the optical axis of the policy's camera [m], inf where nothing is measured, shape (H, W).

        Raises:
            ValueError: If their size differs from the robot's images, or they are colours.
        """
        if depth_m.ndim != 2:
            raise ValueError("colours where depths are due: name the topic of the depths with --depth")
        if depth_m.shape != self._size:
            raise ValueError(
                f"depths of {depth_m.shape[0]}x{depth_m.shape[1]} px, and images of {self._size[0]}x{self._size[1]}: "
                "have its driver align them to the colours"
            )
        if self.identity:
            return depth_m
        nowhere = float("inf")
        found = cv2.remap(
            depth_m, *self._nearest, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=nowhere
        )
        return np.asarray(found / self._ahead, np.float32)


def inside_of(uv: Float64Array, camera: CameraConfig) -> BoolArray:
    """True for pixel positions inside a camera's image, shape (..., 2) [px] -> (...)."""
    inside = (uv >= 0.0).all(axis=-1) & (uv[..., 0] <= camera.width_px) & (uv[..., 1] <= camera.height_px)
    return np.asarray(inside, np.bool_)


def mount_differences(robot: CameraConfig, policy: CameraConfig) -> list[str]:
    """Differences of the cameras' mounts that rectification cannot correct, in words."""
    names = ("mount_x_m", "mount_y_m", "mount_height_m")
    return [
        f"{name} {getattr(policy, name):g} (the robot's: {getattr(robot, name):g})"
        for name in names
        if abs(getattr(policy, name) - getattr(robot, name)) > MOUNT_MAX_M
    ]


def camera_from_info(mount: CameraConfig, info: LogCamera) -> CameraConfig:
    """The camera of a CameraInfo, with the mount of a different camera.

    Raises:
        ConfigError: If the lens model is unknown, or the camera is not calibrated.
    """
    if not (len(info.K_px) == 9 and info.K_px[0] > 0 and info.K_px[4] > 0):
        raise ConfigError(
            "The robot's CameraInfo holds no intrinsics: its camera is not calibrated. Calibrate it "
            "(ROS: camera_calibration), and pass the file with --calibration."
        )
    return camera_of(mount, info)


def info_of(camera: CameraConfig) -> LogCamera:
    """The CameraInfo of a camera."""
    K = camera.K_px
    K[:2, 2] -= 0.5
    return LogCamera(
        height_px=camera.height_px,
        width_px=camera.width_px,
        K_px=tuple(K.reshape(-1).tolist()),
        model="equidistant" if camera.distortion == "fisheye" else "plumb_bob",
        distortion=camera.coefficients,
    )


def camera_from_file(mount: CameraConfig, path: Path, name: str = "", image: str = "") -> CameraConfig:
    """Read a camera from a file: `robot.toml`, or the .yaml of ROS's camera_calibration.

    Args:
        mount: Camera whose mount is used if the file has none.
        path: The file.
        name: Name of the camera; the first one is called "".
        image: Topic of its images, which says whether they are rectified; a `robot.toml` describes them as they are.

    Raises:
        ConfigError: If the file cannot be read, or holds no such camera.
    """
    if path.suffix == ".toml":
        robot = load_robot(path, cameras_of=RobotConfig(camera=mount))
        if name and name not in robot.cameras:
            raise ConfigError(f"--calibration {path} has no camera {name!r}; it has {', '.join(robot.all_cameras)}.")
        return robot.cameras[name] if name else robot.camera
    if name:
        raise ConfigError(f"--calibration {path} is of one camera: for several give a robot.toml, or leave it out.")
    storage = _open_file_storage(path)
    try:
        info = LogCamera(
            height_px=int(storage.getNode("image_height").real()),
            width_px=int(storage.getNode("image_width").real()),
            K_px=_data(storage, "camera_matrix"),
            model=storage.getNode("distortion_model").string(),
            distortion=_data(storage, "distortion_coefficients"),
            P_px=_data(storage, "projection_matrix"),
        )
    except (cv2.error, ValueError, OverflowError) as error:
        raise ConfigError(f"Calibration {path} holds something else than numbers where they are due.") from error
    finally:
        storage.release()
    if len(info.K_px) != 9 or not info.height_px or not info.width_px:
        raise ConfigError(
            f"Calibration {path} lacks image_width, image_height or camera_matrix: pass what ROS's camera_calibration "
            "wrote, or a robot.toml with a section [camera]."
        )
    return camera_from_info(mount, info.of_images(image))


def _open_file_storage(path: Path) -> cv2.FileStorage:
    try:
        text = path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"Calibration {path} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    # OpenCV's reader requires this header, and can read what ROS writes below it.
    head = "" if text.startswith("%YAML") else "%YAML:1.0\n---\n"
    try:
        return cv2.FileStorage(head + text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (cv2.error, SystemError) as error:  # OpenCV's reader raises either
        raise ConfigError(f"Calibration {path} is no YAML file that can be read.") from error


def _data(storage: cv2.FileStorage, name: str) -> tuple[float, ...]:
    data = storage.getNode(name).getNode("data") if not storage.getNode(name).empty() else None
    return tuple(data.at(index).real() for index in range(data.size())) if data is not None else ()


def _centres(camera: CameraConfig, count: int) -> Float64Array:
    """Pixels of an image that is `count` times as fine along each side [px], shape (count H, count W, 2)."""
    u = (np.arange(camera.width_px * count) + 0.5) / count
    v = (np.arange(camera.height_px * count) + 0.5) / count
    return np.stack(np.meshgrid(u, v), axis=2)


def _places(robot: CameraConfig, policy: CameraConfig, count: int) -> tuple[Float64Array, Float64Array]:
    """Pixel positions in the robot's image of the pixels of a finer policy image [px]; NaN outside of the image.

    Also returns the depth in the robot's camera of a point at depth 1 m in the policy's camera [m].
    """
    centres = _centres(policy, count)
    xy = make_lens(policy).rays(centres.reshape(-1, 2))
    rays = np.concatenate([xy, np.ones((len(xy), 1))], axis=1)
    R_base_policy, R_base_robot = (camera.T_world_camera(0.0, 0.0, 0.0, 0.0)[:3, :3] for camera in (policy, robot))
    turned = rays @ (R_base_policy.T @ R_base_robot)
    ahead = turned[:, 2] > 1e-6
    plane = turned[:, :2] / np.where(ahead, turned[:, 2], 1.0)[:, None]
    lens = make_lens(robot)
    shown = ahead & (np.hypot(*plane.T) <= lens.radius_max)
    uv = np.where(shown[:, None], lens.pixels(plane), np.nan)
    return uv.reshape(centres.shape), np.where(ahead, turned[:, 2], 1.0).reshape(centres.shape[:2])
