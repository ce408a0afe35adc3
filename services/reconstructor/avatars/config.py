"""Settings of an avatar's extraction, and their presets."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges

AvatarPreset = Literal["draft", "standard"]


@dataclass(frozen=True, kw_only=True)
class PosePriorConfig:
    """How far poses are trusted. The errors of given poses are found from the poses themselves, joint by joint."""

    in_order: bool = True
    """True if the frames follow each other in time, at one rate or as the numbers in their names tell; else given poses
    are trusted to `joint_deg` and `root_m`, each by itself."""
    drift_deg: Annotated[float, Range(low=0.0)] = 1.0
    """Standard deviation of errors of given rotations that last for many frames, and so do not show in them [deg]."""
    drift_m: Annotated[float, Range(low=0.0)] = 0.01
    """The same of given positions of the pelvis [m]."""
    joint_deg: Annotated[float, Range(above=0.0)] = 3.0
    """Standard deviation of given rotations of joints that are not in order [deg]."""
    root_m: Annotated[float, Range(above=0.0)] = 0.02
    """Standard deviation of given positions of the pelvis that are not in order [m]."""
    jerk_deg: Annotated[float, Range(above=0.0)] = 2.5
    """For poses from keypoints: standard deviation of how far a joint is from the middle of the frames before and after
    [deg]."""
    jerk_m: Annotated[float, Range(above=0.0)] = 0.008
    """The same of the pelvis [m]."""
    weight: Annotated[float, Range(low=0.0)] = 0.001
    """Weight in the loss of the mean squared deviation, in units of the standard deviations."""
    contacts: Annotated[float, Range(low=0.0)] = 1e-4
    """Weight in the loss of soles that stand but float or slip, in each frame in order; the floor is found."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class KeypointsConfig:
    """How poses are found from keypoints, and how far they are trusted afterwards."""

    sigma_share: Annotated[float, Range(above=0.0, high=0.2)] = 0.01
    """Standard deviation of keypoints, as a share of the person's height in the image."""
    joint_deg: Annotated[float, Range(above=0.0)] = 10.0
    """Standard deviation of the rotations of joints that are found [deg]."""
    root_m: Annotated[float, Range(above=0.0)] = 0.05
    """Standard deviation of the positions of the pelvis that are found [m]."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class FixedCameraConfig:
    """The camera of a video, which stands still on the floor z = 0 and looks along x."""

    intrinsics: str = ""
    """Its lens, without distortion: a calibration of OpenCV or ROS, a .json of cameras, or "fx fy cx cy" in pixels of
    the upright frames; empty: that of most phones."""
    height_m: Annotated[float, Range(above=0.0, high=10.0)] = 1.4
    """Height of the lens above the floor [m]; the person's size grows with it."""
    tilt_deg: Annotated[float, Range(low=-60.0, high=60.0)] = 0.0
    """How far it looks down [deg]."""
    rate_hz: Annotated[float, Range(low=5.0, high=60.0)] = 20.0
    """About so many frames a second are taken, fewer of long videos."""
    check_still: bool = True
    """True refuses videos whose background moves; false is for cameras that are known to stand still."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class AvatarFitConfig:
    """How an avatar is extracted. The result is a function of these settings and of the film."""

    representation: Literal["direct", "hugs"] = "direct"
    """`direct`: parameters of each Gaussian; `hugs`: feature planes and decoders of HUGS, which is slower."""
    hugs_points: Annotated[int, Range(low=500, high=200_000)] = 10_000
    """Gaussians of `hugs`."""
    steps: Annotated[int, Range(low=10)] = 3600
    """Optimisation steps, one frame each."""
    side_max_px: Annotated[int, Range(low=32)] = 512
    """Larger images are made smaller: longer side [px]."""
    hold_out: Annotated[int, Range(low=0)] = 8
    """Every so-manieth frame changes the motion alone (its neighbours' too, which is smooth), and measures the quality;
    0: none."""
    gaussians_max: Annotated[int, Range(low=1000, high=300_000)] = 60_000
    """Most Gaussians of the avatar."""
    mask_weight: Annotated[float, Range(low=0.0)] = 0.2
    """Weight of the difference of opacity and mask."""
    anchor: Annotated[float, Range(low=0.0)] = 1e-3
    """Weight of the Gaussians' squared distance from where they began on the body [1/m2]."""
    isotropy: Annotated[float, Range(low=0.0)] = 0.0
    """Weight of each drawn Gaussian's squared logarithm of how many times its longest axis is longer than the middle
    one."""
    offsets: bool = True
    """True also finds joints that do not lie in the direction of the first body's bones; `direct` only."""
    joint_scene: bool = True
    """True also learns the colours and opacities of a given scene, and lets what stands before the person hide it."""
    seed: int = 0
    """Seed of the fit."""
    prior: PosePriorConfig = field(default_factory=PosePriorConfig)
    keypoints: KeypointsConfig = field(default_factory=KeypointsConfig)
    camera: FixedCameraConfig = field(default_factory=FixedCameraConfig)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.hold_out == 1:
            raise ValueError("hold_out must be 0 or at least 2, got 1: nothing would be left to learn from.")


def avatar_preset(name: AvatarPreset) -> AvatarFitConfig:
    """The settings of a name: `draft` takes minutes on one core, `standard` is for longer."""
    if name == "draft":
        return AvatarFitConfig()
    return AvatarFitConfig(steps=15_000, side_max_px=1024, gaussians_max=90_000)
