"""Configuration of the reconstructor."""

from dataclasses import dataclass, field

from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.metric.config import MetricConfig
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.training.config import GaussiansConfig


@dataclass(frozen=True, kw_only=True)
class ReconstructorConfig:
    """How a video or photos become posed, metric images, and these Gaussians."""

    frames: FramesConfig = field(default_factory=FramesConfig)
    poses: PosesConfig = field(default_factory=PosesConfig)
    metric: MetricConfig = field(default_factory=MetricConfig)
    gaussians: GaussiansConfig = field(default_factory=GaussiansConfig)
