"""Settings of the renderer, and named cameras."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.camera.config import COEFFICIENT_NAMES, SENSOR_LIMITS
from readygo.common.errors import ConfigError
from readygo.common.images.images import OUTPUTS
from readygo.common.images.names import DEPTH, MEDIAN_DEPTH
from readygo.common.rasterizer.backend_names import GPU_BACKENDS, GSPLAT_OUTPUTS, Backend
from readygo.common.robot import RobotConfig


@dataclass(frozen=True, kw_only=True)
class RendererConfig:
    """How images are made and encoded; recorded with every dataset."""

    backend: Backend = "cpu"
    """"reference" is the slow oracle of `readygo.common.rasterizer.reference`: seconds per image; "triton" and "gsplat"
    draw on a GPU and are experimental, see `common/rasterizer/gpu`."""
    image_format: Literal["jpeg", "png"] = "jpeg"
    """Encoding of recorded images; "png" is lossless."""
    jpeg_quality: int = 90
    """Quality of JPEG images, 1..100."""
    outputs: tuple[str, ...] = ("rgb",)
    """Images that are recorded, of `readygo.common.images.images.OUTPUTS`; "rgb" is always among them."""
    depth: Literal["median", "mean"] = "median"
    """What the image depth is: "median" is where half of the light is left, the depth of a surface; "mean" is weighted
    as colours are, so that what lies behind thin Gaussians counts too. The backend gsplat makes "mean" alone."""
    goal_image: bool = False
    """Record once per episode what the first camera shows at the goal, where the shortest path arrives, without
    humans."""
    labels: bool = True
    """Record joints, box and footprint of every human with each sample."""
    detail: Literal["exact", "lod"] = "exact"
    """"lod" draws far things and people with fewer Gaussians, about twice as fast; backend cpu only."""
    contact_shadow: bool = False
    """True puts soft shadows under people's feet; `triton` and `gsplat` draw none."""
    feet_on_floor: bool = True
    """True draws feet before the relief of the floor that they stand on, False in the order of their depths alone, as
    `triton` and `gsplat` do in any case."""
    human_light: bool = True
    """True lights people as the scene does where they walk; False draws them in their avatars' own colours."""
    human_look: Literal["photoreal", "mesh"] = "photoreal"
    """"mesh" draws people as a game engine's simple assets: a flat colour per part of the body, under one fixed light
    wherever they walk; the comparison of policies that learn from one kind of people or the other."""
    sensor: SensorConfig = field(default_factory=SensorConfig)
    """What varies of the robot's camera from episode to episode; nothing by default."""
    sub_frames: int = 8
    """Images drawn per frame where the camera's shutter takes time: the cost of a frame grows with it. Enough are those
    between which the image moves by about a pixel."""

    def __post_init__(self) -> None:
        if self.backend not in get_args(Backend):
            raise ValueError(f"backend must be one of {', '.join(get_args(Backend))}, got {self.backend!r}.")
        if self.detail not in ("exact", "lod"):
            raise ValueError(f'detail must be "exact" or "lod", got {self.detail!r}.')
        if self.detail == "lod" and self.backend != "cpu":
            raise ValueError(f'detail "lod" is drawn by the backend cpu only, got {self.backend!r}.')
        if self.human_look not in ("photoreal", "mesh"):
            raise ValueError(f'human_look must be "photoreal" or "mesh", got {self.human_look!r}.')
        if self.human_look == "mesh" and self.backend in GPU_BACKENDS:
            raise ValueError(
                f'human_look "mesh" is drawn by the backends cpu and reference only, got {self.backend!r}.'
            )
        if self.depth not in ("median", "mean"):
            raise ValueError(f'depth must be "median" or "mean", got {self.depth!r}.')
        if self.image_format not in ("jpeg", "png"):
            raise ValueError(f'image_format must be "jpeg" or "png", got {self.image_format!r}.')
        if not 1 <= self.jpeg_quality <= 100:
            raise ValueError(f"jpeg_quality must be 1..100, got {self.jpeg_quality}.")
        if not 2 <= self.sub_frames <= 64:
            raise ValueError(f"sub_frames must be 2..64, got {self.sub_frames}.")
        unknown = [name for name in self.outputs if name not in OUTPUTS]
        if unknown:
            raise ValueError(f"outputs must be of {', '.join(OUTPUTS)}, got {unknown[0]!r}.")
        if "rgb" not in self.outputs:
            raise ValueError(f"outputs must hold rgb, got {', '.join(self.outputs) or 'none'}; add it.")
        # One order, so that the same images are the same run.
        object.__setattr__(self, "outputs", tuple(name for name in OUTPUTS if name in self.outputs))
        if self.backend == "gsplat" and self.depth == "median" and DEPTH in self.outputs:
            raise ValueError('the backend gsplat makes no median depth: set depth = "mean", or use triton.')
        lacking = [name for name in self.outputs if self.backend == "gsplat" and name not in GSPLAT_OUTPUTS]
        if lacking:
            raise ValueError(
                f"the backend gsplat makes no {', '.join(lacking)}: leave it out of outputs, or use triton."
            )

    def rasterizer_outputs(self, kinds: Iterable[str]) -> tuple[str, ...]:
        """What the rasterizer makes for kinds of images: of `readygo.common.images.images.OUTPUTS`, each once."""
        depth = MEDIAN_DEPTH if self.depth == "median" else DEPTH
        return tuple(dict.fromkeys(depth if kind == DEPTH else kind for kind in kinds))

    def check_robot(self, robot: RobotConfig) -> None:
        """Raise ConfigError if the backend cannot draw what the cameras of a robot's ranges see."""
        if robot.ranges.horizontal_fov_deg and self.backend in GPU_BACKENDS:
            raise ConfigError(
                f"robot.ranges.horizontal_fov_deg: the backend {self.backend} draws one field of view; leave the range "
                "out, or use the backend cpu."
            )

    def draws(self, name: Literal["contact_shadow", "feet_on_floor"]) -> bool:
        """Whether a setting is on, and the backend draws it."""
        return bool(getattr(self, name)) and self.backend not in GPU_BACKENDS


SensorName = Literal["off", "sensor_phone_like"]
"""Names of the recipes in `SENSOR_RECIPES`."""
SensorRecipe = Callable[[CameraConfig, RendererConfig], tuple[CameraConfig, RendererConfig]]
"""Gives a camera and the way that it is drawn other optics; image size, intrinsics, mount and latency are kept."""


def sensor_off(camera: CameraConfig, renderer: RendererConfig) -> tuple[CameraConfig, RendererConfig]:
    """The ideal pinhole camera."""
    changed = {"distortion", *COEFFICIENT_NAMES, *SENSOR_LIMITS}
    kept = {
        entry.name: getattr(camera, entry.name) for entry in dataclasses.fields(camera) if entry.name not in changed
    }
    return CameraConfig(**kept), dataclasses.replace(renderer, sensor=SensorConfig())


def sensor_phone_like(camera: CameraConfig, renderer: RendererConfig) -> tuple[CameraConfig, RendererConfig]:
    """A small camera module as in a phone: slight distortion, noise, motion blur and rolling shutter, all varied."""
    plain, _ = sensor_off(camera, renderer)
    sensor = SensorConfig(
        k1=(-0.04, 0.01),
        k2=(-0.002, 0.006),
        p1=(-0.001, 0.001),
        p2=(-0.001, 0.001),
        exposure_ev=(-0.3, 0.3),
        red_gain=(0.92, 1.08),
        blue_gain=(0.92, 1.08),
        vignetting=(0.05, 0.3),
        shot_noise=(0.005, 0.02),
        read_noise=(0.0005, 0.002),
        exposure_s=(1 / 200, 1 / 60),
        readout_s=(0.010, 0.020),
    )
    phone = sensor.middle(dataclasses.replace(plain, distortion="brown_conrady"))
    return phone, dataclasses.replace(renderer, sensor=sensor, sub_frames=4)


SENSOR_RECIPES: Mapping[SensorName, SensorRecipe] = {
    "off": sensor_off,
    "sensor_phone_like": sensor_phone_like,
}
"""Recipes by the name that the command line takes."""
