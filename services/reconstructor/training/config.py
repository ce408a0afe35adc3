"""Configuration of a training of Gaussians, and its presets."""

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges

Preset = Literal["draft", "standard", "high"]
Device = Literal["cpu", "cuda"]


@dataclass(frozen=True, kw_only=True)
class DensityConfig:
    """Where Gaussians are added and removed."""

    method: Literal["gradients", "mcmc"] = "gradients"
    """`gradients` adds them where the absolute gradients of their projected means are large (AbsGS); `mcmc` keeps to a
    budget that grows to `count_max`, moves dead ones and adds noise (Kheradmand et al., 3DGS as MCMC, 2024)."""
    count_max: Annotated[int, Range(low=100)] = 150_000
    """Most Gaussians of the scene."""
    weak_texture: bool = False
    """True for places with bare walls: nothing is split for its absolute gradients, faint Gaussians go early."""
    growth: Annotated[float, Range(low=0.0)] = 0.05
    """Share of Gaussians that `mcmc` adds each time."""

    @property
    def needs_absolute(self) -> bool:
        """Whether pixels' absolute gradients decide; else their sum does, which hides what pulls both ways."""
        return not self.weak_texture and self.method == "gradients"

    @property
    def gradient_min(self) -> float:
        """Mean gradient of the projected mean from which on a Gaussian is cloned or split, for an image of 2x2 units.

        Source: AbsGS for absolute gradients; 3DGS for their sum.
        """
        return 2e-4 if self.weak_texture else 8e-4

    @property
    def opacity_min(self) -> float:
        """Fainter ones are removed or moved."""
        return 0.05 if self.weak_texture else 0.005

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class GeometryConfig:
    """Losses that make Gaussians lie on surfaces (Chen et al., PGSR, 2024)."""

    enabled: bool = False
    """True adds these losses to the photometric one."""
    flatten: Annotated[float, Range(low=0.0)] = 100.0
    """Weight of the mean shortest standard deviation of the Gaussians that a view shows [1/m]."""
    normal: Annotated[float, Range(low=0.0)] = 0.015
    """Weight of how normals differ from those of the depths, within a view."""
    consistent: Annotated[float, Range(low=0.0)] = 0.03
    """Weight of how far pixels come back from a neighbour [1/px]."""
    ncc: Annotated[float, Range(low=0.0)] = 0.15
    """Weight of how much grey patches differ from a neighbour's."""
    depth: Annotated[float, Range(low=0.0)] = 0.5
    """Weight of how far depths are off those that a device measured, relative to them."""
    noise_px: Annotated[float, Range(above=0.0)] = 1.0
    """Pixels that come back farther away do not count: something hides them."""
    patches_max: Annotated[int, Range(low=1)] = 4096
    """Most patches per view that are compared with a neighbour's: a random sample."""
    distance_max_m: Annotated[float, Range(low=0.0)] = 0.0
    """Neighbours are at most this far from a view, in units of the poses (metres of `scene poses`); 0: 1.5, and for
    views that have none there as far as the cameras' spacing and the depth of the points suggest."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class GaussiansConfig:
    """How Gaussians are trained. What they come to is a function of these settings and of the posed images."""

    device: Device = "cpu"
    """`cuda` draws with gsplat's kernels."""
    steps: Annotated[int, Range(low=1)] = 7000
    """Optimisation steps."""
    batch: Annotated[int, Range(low=1, high=64)] = 2
    """Views a step; they are drawn side by side on as many cores."""
    side_max_px: Annotated[int, Range(low=32)] = 960
    """Larger images are made smaller: longer side [px]."""
    hold_out: Annotated[int, Range(low=0)] = 8
    """Every so-manieth image is not trained on but measured on, beginning with the first; of a 360-degree image all
    views together. 0: none."""
    sh_degree: Annotated[int, Range(low=0, high=3)] = 3
    """Degree of the spherical harmonics of the colours."""
    seed: int = 0
    """Seed of the training."""
    transients: bool = False
    """Search for what moved while the place was recorded, such as people, and ignore it; all presets do, unless there
    are masks."""
    density: DensityConfig = field(default_factory=DensityConfig)
    geometry: GeometryConfig = field(default_factory=GeometryConfig)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.hold_out == 1:
            raise ValueError("hold_out must be 0 or at least 2, got 1: nothing would be left to train on.")


def weak_texture(settings: GaussiansConfig) -> GaussiansConfig:
    """Settings for places with bare walls."""
    return replace(settings, density=replace(settings.density, weak_texture=True))


def preset(name: Preset) -> GaussiansConfig:
    """The settings of a name: `draft` takes minutes on two cores, `standard` and `high` are for longer."""
    surfaces = GeometryConfig(enabled=True)
    if name == "draft":
        return GaussiansConfig(
            steps=3000,
            side_max_px=640,
            transients=True,
            density=DensityConfig(method="mcmc", count_max=150_000, growth=0.03),
            geometry=surfaces,
        )
    if name == "standard":
        return GaussiansConfig(steps=7000, transients=True, density=DensityConfig(count_max=500_000), geometry=surfaces)
    return GaussiansConfig(
        steps=30_000,
        side_max_px=1600,
        transients=True,
        density=DensityConfig(count_max=2_000_000),
        geometry=surfaces,
    )
