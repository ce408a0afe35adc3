"""Configuration of a training of Gaussians, and its presets."""

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges

Preset = Literal["draft", "standard", "high"]
Device = Literal["cpu", "cuda"]


@dataclass(frozen=True, kw_only=True)
class RatesConfig:
    """Learning rates of Adam, for one view a step; a batch of n views multiplies them by the square root of n."""

    means: Annotated[float, Range(above=0.0)] = 1.6e-4
    """Rate of the positions, in extents of the scene; falls to a hundredth."""
    scales: Annotated[float, Range(above=0.0)] = 5e-3
    """Rate of the logarithms of the scales."""
    quats: Annotated[float, Range(above=0.0)] = 1e-3
    opacities: Annotated[float, Range(above=0.0)] = 5e-2
    """Rate of the logits of the opacities."""
    colours: Annotated[float, Range(above=0.0)] = 2.5e-3
    """Rate of the SH coefficient of degree 0; the others have a twentieth of it."""
    exposures: Annotated[float, Range(above=0.0)] = 1e-3

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class DensityConfig:
    """Where Gaussians are added and removed. Times are shares of the training."""

    method: Literal["gradients", "mcmc"] = "gradients"
    """`gradients` adds them where the absolute gradients of their projected means are large (AbsGS); `mcmc` keeps to a
    budget that grows to `count_max`, moves dead ones and adds noise (Kheradmand et al., 3DGS as MCMC, 2024)."""
    count_max: Annotated[int, Range(low=100)] = 150_000
    every: Annotated[int, Range(low=1)] = 100
    """Steps between two times that Gaussians are added and removed."""
    begin: Annotated[float, Range(low=0.0, high=1.0)] = 0.02
    end: Annotated[float, Range(low=0.0, high=1.0)] = 0.5
    absolute: bool = True
    """Look at the pixels' absolute gradients; else at their sum, which hides what pulls both ways."""
    gradient_min: Annotated[float, Range(low=0.0)] = 8e-4
    """Mean gradient of the projected mean from which on a Gaussian is cloned or split, for an image of 2x2
    units."""
    split_scale: Annotated[float, Range(above=0.0)] = 0.01
    """Gaussians larger than this are split, smaller ones cloned: in extents of the scene."""
    opacity_min: Annotated[float, Range(low=0.0, high=1.0)] = 0.005
    """Fainter ones are removed or moved."""
    scale_max: Annotated[float, Range(above=0.0)] = 0.1
    """Larger ones are removed, in extents of the scene; `gradients` only."""
    stretch_max: Annotated[float, Range(low=1.0)] = 20.0
    """A Gaussian's longest axis is at most this many times its middle one: longer ones look right from the cameras
    alone, and are needles from elsewhere."""
    reset_every: Annotated[float, Range(above=0.0)] = 0.2
    """Opacities are made small so often; `gradients` only."""
    growth: Annotated[float, Range(low=0.0)] = 0.05
    """Share of Gaussians that `mcmc` adds each time."""
    noise: Annotated[float, Range(low=0.0)] = 5e5
    """Size of the noise, in learning rates of the means; `mcmc` only."""
    regular: Annotated[float, Range(low=0.0)] = 0.01
    """Weights of the mean opacity and the mean scale in the loss; `mcmc` only."""

    @property
    def needs_absolute(self) -> bool:
        """Whether anything is decided by absolute gradients."""
        return self.absolute and self.method == "gradients"

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class GeometryConfig:
    """Losses that make Gaussians lie on surfaces (Chen et al., PGSR, 2024)."""

    enabled: bool = False
    begin: Annotated[float, Range(low=0.0, high=1.0)] = 0.23
    """Share of the training after which normals and neighbours are compared; Gaussians are flattened from the start."""
    flatten: Annotated[float, Range(low=0.0)] = 100.0
    """Weight of the mean shortest standard deviation of the Gaussians that a view shows [1/m]."""
    normal: Annotated[float, Range(low=0.0)] = 0.015
    """Weight of how normals differ from those of the depths, within a view."""
    consistent: Annotated[float, Range(low=0.0)] = 0.03
    """Weight of how far pixels come back from a neighbour [1/px]."""
    ncc: Annotated[float, Range(low=0.0)] = 0.15
    """Weight of how much grey patches differ from a neighbour's."""
    noise_px: Annotated[float, Range(above=0.0)] = 1.0
    """Pixels that come back farther away do not count: something hides them."""
    patches_max: Annotated[int, Range(low=1)] = 4096
    neighbours: Annotated[int, Range(low=1)] = 8
    angle_max_deg: Annotated[float, Range(above=0.0, high=180.0)] = 30.0
    distance_min_m: Annotated[float, Range(low=0.0)] = 0.01
    distance_max_m: Annotated[float, Range(above=0.0)] = 1.5
    """Neighbours are between these distances from a view."""
    trim_every: Annotated[float, Range(above=0.0)] = 0.1
    """After each such share of the training, while Gaussians are added, those that few views show are removed."""
    trim_views: Annotated[int, Range(low=0)] = 2
    """Gaussians must be seen by so many."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class GaussiansConfig:
    """How Gaussians are trained. What they come to is a function of these settings and of the posed images."""

    device: Device = "cpu"
    """`cuda` draws with gsplat's kernels."""
    steps: Annotated[int, Range(low=1)] = 7000
    batch: Annotated[int, Range(low=1, high=64)] = 2
    """Views a step; they are drawn side by side on as many cores."""
    side_max_px: Annotated[int, Range(low=32)] = 960
    """Larger images are made smaller: longer side [px]."""
    coarse: Annotated[int, Range(low=1, high=16)] = 4
    """Images begin at this fraction of their size, and double until they are whole."""
    coarse_end: Annotated[float, Range(low=0.0, high=1.0)] = 0.4
    """Share of the training after which images are whole."""
    hold_out: Annotated[int, Range(low=0)] = 8
    """Every so-manieth image is not trained on but measured on, beginning with the first; 0: none."""
    sh_degree: Annotated[int, Range(low=0, high=3)] = 3
    sh_every: Annotated[float, Range(above=0.0)] = 0.1
    """Another degree of spherical harmonics begins after each such share of the training."""
    between: bool = True
    """Gaussians begin between the map's points as well, where images agree on a surface."""
    exposure: bool = True
    """Every training image has separate gains and offsets (photos of one automatic exposure differ)."""
    ssim_weight: Annotated[float, Range(low=0.0, high=1.0)] = 0.2
    preview_every: Annotated[int, Range(low=1)] = 500
    """Steps from one held-out picture and measurement to the next."""
    seed: int = 0
    rates: RatesConfig = field(default_factory=RatesConfig)
    density: DensityConfig = field(default_factory=DensityConfig)
    geometry: GeometryConfig = field(default_factory=GeometryConfig)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.hold_out == 1:
            raise ValueError("hold_out must be 0 or at least 2, got 1: nothing would be left to train on.")


def weak_texture(settings: GaussiansConfig) -> GaussiansConfig:
    """Settings for places with bare walls: nothing is split for its absolute gradients, faint Gaussians go early."""
    density = replace(settings.density, absolute=False, gradient_min=2e-4, opacity_min=0.05)
    return replace(settings, density=density)


def preset(name: Preset) -> GaussiansConfig:
    """The settings of a name: `draft` takes minutes on two cores, `standard` and `high` are for longer."""
    surfaces = GeometryConfig(enabled=True)
    if name == "draft":
        return GaussiansConfig(
            steps=3000,
            side_max_px=640,
            density=DensityConfig(method="mcmc", count_max=150_000, growth=0.03),
            geometry=surfaces,
        )
    if name == "standard":
        return GaussiansConfig(steps=7000, density=DensityConfig(count_max=500_000), geometry=surfaces)
    return GaussiansConfig(
        steps=30_000, side_max_px=1600, density=DensityConfig(count_max=2_000_000), geometry=surfaces
    )
