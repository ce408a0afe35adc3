"""How a policy is trained."""

import dataclasses
from dataclasses import dataclass, field
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges
from readygo.common.images.names import RGB
from readygo.common.policy.sight import check_images
from readygo.common.policy.windows import FRAME_COUNT

CHECKPOINT_FILE = "checkpoint.pt"
"""State of a training, beside what it writes."""
PERCEPTION_WIDTHS, PERCEPTION_SPACING_S = (24, 40, 56, 88, 160), 0.2
"""Channels of the network of perception, and the time between the frames that it sees [s], unless others are given."""

Share = Annotated[float, Range(low=0.0, high=1.0)]
Positive = Annotated[float, Range(above=0.0)]
MINUTES = Range(above=0.0, high=100_000.0)
"""Budgets [min]; the largest is ten weeks."""
Count = Annotated[int, Range(low=1)]
NotNegative = Annotated[float, Range(low=0.0)]


@dataclass(frozen=True, kw_only=True)
class NetworkConfig:
    """The network. The defaults are the paper's."""

    fusion: Literal["late", "early"] = "late"
    """"late": each frame is encoded alone, the latents of all are put side by side; "early": one pass over all frames,
    stacked."""
    frame_count: Annotated[int, Range(low=1, high=32)] = FRAME_COUNT
    """Frames that it sees together, `frame_spacing_s` apart."""
    images: tuple[str, ...] = (RGB,)
    """What each frame is of, see `readygo.common.policy.sight`: rgb, depth where the data have it, and images of
    further cameras."""
    goal: Literal["point", "image", "both"] = "point"
    """What it is told of the goal: where it is, what the robot would see there, by the encoder of the frames, or
    both."""
    latent_count: Count = 20
    """Numbers that the encoder answers."""
    motion: Literal["poses", "command"] = "command"
    """Form of the ego-motion that the network gets, see `readygo.services.trainer.inputs.MotionInput`."""
    memory_count: Annotated[int, Range(low=0, high=1024)] = 0
    """Numbers that it remembers from frame to frame, `frame_spacing_s` apart (a gated recurrent unit); 0: none. In
    training it remembers the earlier samples of a chain."""
    widths: tuple[int, ...] = (32, 64, 128, 192, 272)
    """Channels of the stem and of the four residual blocks."""
    encoder: Literal["own", "perception"] = "own"
    """"own": an encoder that learns with the policy; "perception": trained perception, whose weights stay as they are,
    and `widths` are those of its network."""
    pooled_height_px: Annotated[int, Range(low=0)] = 0
    """Larger images are pooled by the largest whole factor that leaves this height; 0 takes them as they are [px]."""
    output: Literal["regression", "bins", "weighed"] = "regression"
    """"regression": v and w, by their squared error; "bins": a distribution over a grid of both, by its cross-entropy,
    of which the mode and its neighbours are answered; "weighed": the same on the grid of
    `readygo.common.robot.command_grid`, less what each command risks, which is learned beside it."""

    def __post_init__(self) -> None:
        check_ranges(self)
        check_images(self.images)
        if self.goal != "point" and (self.images != (RGB,) or self.fusion != "late"):
            raise ValueError(
                f'goal "{self.goal}" goes with the rgb of one camera and fusion "late", got '
                f'{", ".join(self.images)} and "{self.fusion}".'
            )
        if self.memory_count and self.goal != "point":
            raise ValueError(f'memory_count goes with goal "point", got "{self.goal}".')
        if len(self.widths) != 5 or min(self.widths) < 1:
            raise ValueError(f"widths must be five channel counts, got {self.widths}.")
        if self.encoder == "perception" and not self._sees_as_perception:
            raise ValueError(
                f'encoder "perception" sees {FRAME_COUNT} rgb frames of 72 rows: it goes with fusion "early", '
                'motion "poses", goal "point" and pooled_height_px 72.'
            )

    @property
    def _sees_as_perception(self) -> bool:
        frames = self.fusion, self.frame_count, self.images, self.pooled_height_px
        return frames == ("early", FRAME_COUNT, (RGB,), 72) and (self.motion, self.goal) == ("poses", "point")


@dataclass(frozen=True, kw_only=True)
class SamplingConfig:
    """What the network is shown, and what it shall answer. The defaults go with the paper's network."""

    batch_size: Count = 64
    """Samples per step."""
    chain_length: Count = 8
    """Samples of one episode in a batch, one frame spacing apart, so that they share encoded frames."""
    frame_spacing_s: Positive = 0.5
    """Time between the frames that the policy sees [s], a multiple of that between two images of the camera."""
    ahead_s: NotNegative = 0.0
    """How far ahead of its frame the command is that a sample teaches [s], to the nearest step."""
    shift_px: Annotated[int, Range(low=0)] = 4
    """Largest shift of the images [px]; 0 turns it off."""
    yaw_error_rad: NotNegative = 0.1
    """Standard deviation of a yaw error that images and goals are turned by [rad]; 0 turns it off."""
    hindsight: Share = 0.5
    """Share of the samples that the expert drove whose goal is a place that the robot reached later."""
    risks_weight: NotNegative = 4.0
    """Weight of what commands risk in the loss ("weighed" only)."""
    humans_weight: NotNegative = 0.0
    """Weight of a further loss in training alone: presence, bearing and distance of the nearest visible human."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class OptimizerConfig:
    """How the weights are changed."""

    learning_rate: Positive = 1e-3
    """Learning rate between the warm-up and the decay."""
    decay_share: Share = 0.2
    """The last share of the budget, over which it falls to a hundredth; 0 keeps it."""
    weight_decay: NotNegative = 1e-4
    """Decoupled weight decay (AdamW); 0 is plain Adam."""
    ema_decay: Annotated[float, Range(low=0.0, high=0.99999)] = 0.995
    """Decay per step of the averaged weights that are validated and exported; 0 exports the latest weights."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """One training run."""

    minutes: Annotated[float, MINUTES] = 10.0
    """Processor time of each training thread, on a GPU the time that goes by; runs that continue count that of the
    earlier ones [min]."""
    samples: int | None = None
    """Samples to be shown instead of `minutes`; the result is then a function of data, config and threads."""
    seed: Annotated[int, Range(low=0)] = 0
    threads: Annotated[int, Range(low=0)] = 0
    """CPU threads; 0 takes every core that the process may use."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """"auto" takes a CUDA device if there is one."""
    precision: Literal["auto", "bf16", "fp32"] = "auto"
    """"auto" computes in bfloat16 on CUDA and on CPUs that multiply it (avx512_bf16, amx_bf16), else in float32."""
    memory_mb: Count = 2048
    """Most memory for episodes as they were recorded; beyond it they are thinned out, every round alike [MB]."""
    cache_mb: Annotated[int, Range(low=0)] = 1024
    """Most memory for decoded frames, or for what a pretrained encoder has of them; the rest is made again for each
    batch [MB]."""
    perception: str = ""
    """Folder of trained perception, which a network with encoder "perception" begins with; in the recipe "perception"
    its weights are trained on."""
    validation_fraction: Annotated[float, Range(low=0.0, high=0.9)] = 0.1
    """Share of the episodes that is held out when no validation data are given."""
    validate_every: Count = 12_000
    """Training samples between validations."""
    offer_every_s: Positive = 60.0
    """Processor time between policies that are offered to the fleet [s]; beside a fleet only."""
    network: NetworkConfig = field(default_factory=NetworkConfig)
    sampling: SamplingConfig = field(default_factory=SamplingConfig)
    optimizer: OptimizerConfig = field(default_factory=OptimizerConfig)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.samples is not None and self.samples < 1:
            raise ValueError(f"samples must be at least 1, got {self.samples}.")
        if self.network.encoder == "perception" and (self.sampling.shift_px or self.sampling.yaw_error_rad):
            raise ValueError('encoder "perception" looks at each image once: shift_px and yaw_error_rad must be 0.')


def fast_recipe() -> TrainConfig:
    """The paper's network and inputs, optimised for minutes on a CPU: for data in which no expert was asked."""
    return TrainConfig()


def paper_recipe() -> TrainConfig:
    """The paper's network, inputs and optimisation, Adam at a constant 1e-4; what it leaves open is as in `fast`.

    Source: ReaDy-Go, section IV-B-2.
    """
    return TrainConfig(optimizer=OptimizerConfig(learning_rate=1e-4, decay_share=0.0, weight_decay=0.0))


def best_recipe() -> TrainConfig:
    """What learns most in a given time from data in which the expert was asked at every state.

    Small images, own motion instead of the previous action, the expert's command 0.4 s ahead, weighed by what commands
    risk, and in training the nearest visible human read from the latents.
    """
    return TrainConfig(
        network=NetworkConfig(
            motion="poses", latent_count=64, pooled_height_px=72, widths=(32, 48, 96, 128, 192), output="weighed"
        ),
        sampling=SamplingConfig(
            ahead_s=0.4,
            chain_length=16,
            batch_size=128,
            shift_px=2,
            yaw_error_rad=0.0,
            risks_weight=10.0,
            humans_weight=2.0,
        ),
        optimizer=OptimizerConfig(learning_rate=2e-3, ema_decay=0.998),
    )


def pretrained_recipe() -> TrainConfig:
    """`best` with the network of perception as its encoder, and a memory: only what reads from it learns.

    It learns from images as they are.
    """
    best = best_recipe()
    network = dataclasses.replace(
        best.network,
        encoder="perception",
        fusion="early",
        latent_count=128,
        memory_count=64,
        widths=PERCEPTION_WIDTHS,
    )
    sampling = dataclasses.replace(best.sampling, frame_spacing_s=PERCEPTION_SPACING_S, humans_weight=0.0, shift_px=0)
    return dataclasses.replace(best, network=network, sampling=sampling, cache_mb=3072)


RECIPES = {"best": best_recipe, "fast": fast_recipe, "paper": paper_recipe, "pretrained": pretrained_recipe}


def with_overrides(config: TrainConfig, **settings: object) -> TrainConfig:
    """The config with those of `settings` that are not None, which may be fields of its sections.

    Raises:
        ValueError: If a setting makes no sense.
    """
    given = {name: value for name, value in settings.items() if value is not None}
    for section in ("network", "sampling", "optimizer"):
        part = getattr(config, section)
        names = {item.name for item in dataclasses.fields(part)} & set(given)
        given[section] = dataclasses.replace(part, **{name: given.pop(name) for name in names})
    return dataclasses.replace(config, **given)  # type: ignore[arg-type]
