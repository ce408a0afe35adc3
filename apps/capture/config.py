"""Settings of a simulated capture."""

import math
from dataclasses import dataclass

from readygo.apps.capture.panorama import face_camera
from readygo.common.camera import CameraConfig
from readygo.common.errors import ConfigError
from readygo.services.reconstructor import DEFAULT_DICTIONARY

FOV_DEG = 68.0
"""Field of view of a phone's main camera, along the longer side of its image [deg]."""
EXPOSURE_S, READOUT_S = 0.010, 0.015
SHOT_NOISE, READ_NOISE = 0.008, 0.001
EXPOSURE_MAX_EV = 3.0
SECONDS_MIN, FRAMES_MAX = 2.0, 3000
PEOPLE_MAX, FPS_MAX_WITH_PEOPLE = 8, 20


@dataclass(frozen=True, kw_only=True)
class CaptureConfig:
    """Settings of one simulated capture."""

    seconds: float = 30.0
    """Duration of the walk [s]."""
    fps: int = 3
    """Frames per second of the video, or photos per second."""
    width_px: int = 640
    height_px: int = 480
    marker_size_m: float = 0.2
    """Printed side of the black square [m]; 0: no marker."""
    marker_dictionary: str = DEFAULT_DICTIONARY
    marker_id: int = 0
    sub_frames: int = 0
    """Images averaged into a frame, for motion blur and rolling shutter; 0: neither."""
    photos: bool = False
    """True takes sharp photos instead of a video."""
    equirectangular: bool = False
    """True takes images of 360 degrees, twice as wide as high, without motion blur."""
    exposure_ev: float = 0.25
    """Amplitude of the drift of a video's automatic exposure [stops]."""
    people: int = 0
    """People who walk through it."""
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.seconds >= SECONDS_MIN:
            raise ConfigError(f"A walk takes {SECONDS_MIN:g} s at least, got {self.seconds:g}.")
        if not 1 <= self.fps <= 60:
            raise ConfigError(f"A video has 1 to 60 frames a second, got {self.fps}.")
        if self.frames > FRAMES_MAX:
            raise ConfigError(f"{self.frames} frames are more than {FRAMES_MAX}; take fewer seconds or a lower --fps.")
        if not self.marker_size_m >= 0.0:
            raise ConfigError(f"The marker's size must be positive, got {self.marker_size_m:g} m; 0 lays down none.")
        if self.sub_frames and not 2 <= self.sub_frames <= 64:
            raise ConfigError(f"A frame is made of 2 to 64 sub-frames, or 0 for none, got {self.sub_frames}.")
        if not 0.0 <= self.exposure_ev <= EXPOSURE_MAX_EV:
            raise ConfigError(f"Exposure drifts by 0 to {EXPOSURE_MAX_EV:g} stops, got {self.exposure_ev:g}.")
        if not 0 <= self.people <= PEOPLE_MAX:
            raise ConfigError(f"0 to {PEOPLE_MAX} people walk through a capture, got {self.people}.")
        if self.people and self.fps > FPS_MAX_WITH_PEOPLE:
            raise ConfigError(f"People move at {FPS_MAX_WITH_PEOPLE} Hz: take a lower --fps, got {self.fps}.")
        if self.equirectangular and self.width_px != 2 * self.height_px:
            raise ConfigError(f"Images of 360 degrees are twice as wide as high, got {self.width_px}x{self.height_px}.")
        if self.equirectangular and (self.people or self.sub_frames):
            raise ConfigError("Images of 360 degrees are recorded without people and without sub-frames.")
        if self.width_px % 2 or self.height_px % 2:
            raise ConfigError(f"Images of videos have even sides, got {self.width_px}x{self.height_px}.")

    @property
    def frames(self) -> int:
        """Number of frames or photos."""
        return round(self.seconds * self.fps)


def phone_camera(config: CaptureConfig) -> CameraConfig:
    """The phone's camera: lens, sensor noise, and rolling shutter if it is simulated; or that of a cube's faces.

    Raises:
        ConfigError: If the image is too large or too small.
    """
    along, across = max(config.width_px, config.height_px), min(config.width_px, config.height_px)
    focal_px = 0.5 * along / math.tan(math.radians(FOV_DEG) / 2)
    try:
        if config.equirectangular:
            return face_camera(config.width_px, shot_noise=SHOT_NOISE, read_noise=READ_NOISE)
        return CameraConfig(
            width_px=config.width_px,
            height_px=config.height_px,
            fx_px=focal_px,
            fy_px=focal_px,
            # No real lens is exactly centred on its sensor.
            cx_px=0.5 * config.width_px + 0.004 * along,
            cy_px=0.5 * config.height_px - 0.003 * across,
            distortion="brown_conrady",
            k1=0.06,
            k2=-0.09,
            p1=0.0004,
            p2=-0.0003,
            vignetting=0.15,
            shot_noise=SHOT_NOISE,
            read_noise=READ_NOISE,
            exposure_s=EXPOSURE_S if config.sub_frames else 0.0,
            readout_s=READOUT_S if config.sub_frames else 0.0,
        )
    except ValueError as error:
        raise ConfigError(str(error)) from error
