"""The policy network: ten convolutions, frames that meet before or after them, three fully connected layers.

The paper gives the number of convolutions, the sizes of the latents (20 per frame, 64 in all) and "2M" parameters;
widths, strides and normalisation are chosen here for training speed on a CPU: a stride-4 stem instead of a
stride-2 one with pooling costs 2.1 ms instead of 5.5 ms per frame (forward and backward, two threads).

Source: ReaDy-Go, section IV-B-2; residual blocks: He et al., Deep residual learning, 2016, with parameter-free
shortcuts (their option A).
"""

import itertools
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from readygo.common.arrays import Float64Array
from readygo.common.policy.sight import channels_by_image
from readygo.common.policy.traits import LIMITS_AT, TRAIT_COUNT, trait_units
from readygo.common.robot import RobotConfig
from readygo.common.robot.command_grid import SPEED_SHARES, TURN_SHARES, backward_rows
from readygo.services.trainer.config import NetworkConfig
from readygo.services.trainer.inputs import GOAL_SCALE_M, Fusion, GoalForm, MotionInput, PolicyInputs
from readygo.services.trainer.pooling import pooling_of
from readygo.services.trainer.pretrained import PretrainedEncoder

NECK_CHANNELS = 32
HEAD_WIDTHS = (256, 128)
HUMANS_WIDTH = 64
CAUTION = 9.0
"""Risk coefficient: subtracted from a command's log-likelihood for a certain collision; measured in
docs/results/trainer.md."""
V_BINS, W_BINS = 9, 17
"""Grid of the actions of output "bins"."""
OFF = -1e4
"""Added to the logits of bins that do not count."""


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions that halve the image, and a shortcut by average pooling and zero channels."""

    def __init__(self, channels_in: int, channels_out: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(channels_in, channels_out, 3, stride=2, padding=1, bias=False)
        self.norm1 = nn.BatchNorm2d(channels_out)
        self.conv2 = nn.Conv2d(channels_out, channels_out, 3, stride=1, padding=1, bias=False)
        self.norm2 = nn.BatchNorm2d(channels_out)
        self.extra_channels = channels_out - channels_in

    def forward(self, x: Tensor) -> Tensor:
        """Feature maps (B, C, H, W) -> (B, C', ceil(H / 2), ceil(W / 2))."""
        y = nn.functional.relu(self.norm1(self.conv1(x)))
        y = self.norm2(self.conv2(y))
        shortcut = nn.functional.avg_pool2d(x, 2, ceil_mode=True, count_include_pad=False)
        return nn.functional.relu(y + nn.functional.pad(shortcut, (0, 0, 0, 0, 0, self.extra_channels)))


class Encoder(nn.Module):
    """Images -> latents: stem 8x8, four residual blocks, 1x1, fully connected."""

    def __init__(self, size_px: tuple[int, int], channels: int, widths: Sequence[int], latent_count: int) -> None:
        super().__init__()
        self.stem = nn.Conv2d(channels, widths[0], 8, stride=4, padding=2, bias=False)
        self.stem_norm = nn.BatchNorm2d(widths[0])
        self.blocks = nn.Sequential(*(ResidualBlock(i, o) for i, o in itertools.pairwise(widths)))
        self.neck = nn.Conv2d(widths[-1], NECK_CHANNELS, 1)
        rows, columns = size_px[0] // 4, size_px[1] // 4
        for _ in self.blocks:
            rows, columns = (rows + 1) // 2, (columns + 1) // 2
        self.latent = nn.Linear(NECK_CHANNELS * rows * columns, latent_count)

    def forward(self, image: Tensor) -> Tensor:
        """Images in [-1, 1], shape (B, C, H, W), channels_last is fastest -> latents (B, L)."""
        x = nn.functional.relu(self.stem_norm(self.stem(image)))
        x = nn.functional.relu(self.neck(self.blocks(x)))
        latents: Tensor = self.latent(x.flatten(1))
        return latents


class Head(nn.Module):
    """Latents, own motion and goal -> what `PolicyNet.decide` makes actions of."""

    def __init__(self, width_in: int, width_out: int) -> None:
        super().__init__()
        self.layer1 = nn.Linear(width_in, HEAD_WIDTHS[0])
        self.layer2 = nn.Linear(HEAD_WIDTHS[0], HEAD_WIDTHS[1])
        self.layer3 = nn.Linear(HEAD_WIDTHS[1], width_out)

    def forward(self, features: Tensor) -> Tensor:
        """Normalised features (B, F) -> (B, width_out)."""
        answers: Tensor = self.layer3(nn.functional.relu(self.layer2(nn.functional.relu(self.layer1(features)))))
        return answers


class Bins(nn.Module):
    """A grid over (v / v_max, w / w_max), on [0, 1] x [-1, 1]; a bin's number is `v_row * w_bins + w_row`.

    Args:
        v_bins: Speeds from rest to full speed.
        w_bins: Yaw rates.
        backward: Speeds backwards, as far apart.
    """

    steps: Tensor
    """Distance of bins along v and w, shape (2,)."""
    centres: Tensor
    """Commands at the centres of the bins, as shares of the largest v and w, shape (N, 2)."""
    beside: Tensor
    """0 for every bin and its neighbours, `OFF` elsewhere, shape (N, N)."""
    standing: Tensor
    """`OFF` for bins in which the robot stands, 0 for the others, shape (N,)."""

    def __init__(self, v_bins: int, w_bins: int, backward: int = 0) -> None:
        super().__init__()
        lowest = -float(backward) / (v_bins - 1)
        v, w = torch.linspace(lowest, 1.0, v_bins + backward), torch.linspace(-1.0, 1.0, w_bins)
        steps, centres = torch.tensor([v[1] - v[0], w[1] - w[0]]), torch.cartesian_prod(v, w)
        apart = (centres[:, None] - centres).abs() / steps
        beside = torch.where((apart < 1.5).all(dim=2), 0.0, OFF)
        standing = torch.where(centres[:, 0].abs() < 1e-6, OFF, 0.0)
        for name, values in (("steps", steps), ("centres", centres), ("beside", beside), ("standing", standing)):
            self.register_buffer(name, values, persistent=False)

    def weights(self, actions: Tensor) -> Tensor:
        """The distribution over bins whose mean is the action: linear between the four around it, shape (B, N)."""
        low, high = self.centres.min(dim=0).values, self.centres.max(dim=0).values
        apart = (actions.clamp(low, high)[:, None] - self.centres).abs() / self.steps
        return (1.0 - apart).clamp(min=0.0).prod(dim=2)

    def mode(self, logits: Tensor) -> Tensor:
        """The mean over the likeliest bin and its neighbours, shape (B, 2)."""
        near = logits + self.beside[logits.argmax(dim=1)]
        return near.softmax(dim=1) @ self.centres


class PolicyNet(nn.Module):
    """Encoder and head, with the robot's limits as units of the actions."""

    limits: Tensor
    lowest: Tensor
    commands: Tensor
    trait_factor: Tensor
    trait_offset: Tensor
    motion_scale: Tensor

    def __init__(self, robot: RobotConfig, config: NetworkConfig, *, reads_humans: bool = False) -> None:
        super().__init__()
        self.inputs = PolicyInputs(
            fusion=Fusion(config.fusion),
            latent_count=config.latent_count,
            motion=MotionInput(config.motion),
            frame_count=config.frame_count,
            images=config.images,
            goal=GoalForm(config.goal),
            robot=robot.ranges.varies,
            memory_count=config.memory_count,
        )
        by_image = channels_by_image(self.inputs.images, self.inputs.frames_together)
        self._by_image = [channel for channels in by_image.values() for channel in channels]
        """Channels in the order of the graph's images: the rgb of all frames, then their depths."""
        self.pooling = pooling_of(robot.camera, config.pooled_height_px)
        size_px = robot.camera.height_px // self.pooling, robot.camera.width_px // self.pooling
        self.encoder: Encoder | PretrainedEncoder
        if config.encoder == "perception":
            self.encoder = PretrainedEncoder(robot.camera, config.widths, config.latent_count)
        else:
            self.encoder = Encoder(size_px, self.inputs.image_channels, config.widths, config.latent_count)
        self.bins = bins_of(config, robot)
        self.caution = CAUTION if config.output == "weighed" else None
        """Risk coefficient; None if commands are not weighed by what they risk."""
        answers = len(self.bins.centres) * (3 if self.caution is not None else 1) if self.bins else 2
        self.head = Head(self.inputs.feature_count + (TRAIT_COUNT if self.inputs.robot else 0), answers)
        self.memory: nn.GRU | None = None
        """Remembers from frame to frame; None without."""
        if config.memory_count:
            self.memory = nn.GRU(self.inputs.memory_input_count, config.memory_count, batch_first=True)
        self.humans = humans_head(self.inputs.latents_width) if reads_humans else None
        """Head that reads humans from the latents, for training alone; None if it is not trained."""
        self.register_buffer("limits", torch.tensor([robot.v_max_mps, robot.w_max_radps]), persistent=False)
        lowest = torch.tensor([robot.v_min_mps / robot.v_max_mps, -1.0])
        self.register_buffer("lowest", lowest, persistent=False)
        """Lowest v and w, as shares of the limits, shape (2,)."""
        commands = torch.from_numpy(command_columns(self.inputs)).float()
        self.register_buffer("commands", commands, persistent=False)
        scale = motion_scale(self.inputs, robot)
        self.register_buffer("motion_scale", torch.tensor(scale), persistent=False)
        for name, units in zip(("trait_factor", "trait_offset"), trait_units(robot), strict=True):
            self.register_buffer(name, torch.from_numpy(units).float(), persistent=False)

    def forward(
        self,
        images: Tensor,
        window: Tensor,
        motion: Tensor,
        goal_xy_m: Tensor,
        traits: Tensor | None = None,
        chains: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """`encode_windows`, in the type that autocast sets, then `remember` and `act` in float32.

        Args:
            images: As for `encode_windows`; with a pretrained encoder what it has of them, see
                `PretrainedEncoder.look`.
            window: As for `encode_windows`.
            motion: Own motion in SI units, shape (B, M).
            goal_xy_m: As for `act`.
            traits: As for `act`.
            chains: See `readygo.services.trainer.samples.chain_rows`, for a network with a memory.

        Returns:
            What the head answers, and what `humans` reads, shape (B, 3); empty without it.
        """
        if isinstance(self.encoder, PretrainedEncoder):
            latents = self.encoder.read(images)
        else:
            latents = self.encode_windows(images, window)
        with torch.autocast(images.device.type, enabled=False):
            latents = latents.float()
            told = self.normalise_motion(motion, traits)
            remembered = None
            if self.memory is not None:
                assert chains is not None
                remembered = self.remember(latents, told, chains)
            answers = self.act(latents, told, goal_xy_m, traits, remembered)
            return answers, latents[:, :0] if self.humans is None else self.humans(latents)

    def encode_windows(self, images: Tensor, window: Tensor) -> Tensor:
        """Latents of windows that share frames.

        Args:
            images: Distinct frames in [-1, 1], shape (F, C, H, W).
            window: Rows of `images` that each sample sees, oldest first, and at last what shows its goal where the
                network sees that, shape (B, `frame_count`) or one more.

        Returns:
            Shape (B, `latents_width`).
        """
        if self.inputs.fusion is Fusion.EARLY:
            stacked = torch.cat([images[window[:, k]] for k in range(self.inputs.frame_count)], dim=1)
            if len(self.inputs.images) > 1:
                stacked = stacked[:, self._by_image]
            together: Tensor = self.encoder(stacked.contiguous(memory_format=torch.channels_last))
            return together
        latents: Tensor = self.encoder(images)[window.reshape(-1)]
        return latents.reshape(len(window), self.inputs.latents_width)

    def remember(self, latents: Tensor, motion: Tensor, chains: Tensor) -> Tensor:
        """What is remembered at each sample of a batch, from the samples before it in its chain, shape (B, R).

        Args:
            latents: From `encode_windows`.
            motion: Own motion from `normalise_motion`.
            chains: See `readygo.services.trainer.samples.chain_rows`.
        """
        assert self.memory is not None
        seen = torch.cat([latents, motion], dim=1)
        remembered: Tensor = self.memory(seen[chains.clamp(min=0)])[0]
        return remembered[chains >= 0]

    def act(
        self,
        latents: Tensor,
        motion: Tensor,
        goal_xy_m: Tensor,
        traits: Tensor | None = None,
        remembered: Tensor | None = None,
    ) -> Tensor:
        """What the head answers, for `decide` and for the loss.

        Args:
            latents: From `encode_windows`, shape (B, `latents_width`).
            motion: Own motion from `normalise_motion`, shape (B, M).
            goal_xy_m: Goals in the robot's frame [m], shape (B, 2).
            traits: Of the robots, where the network is told them (`readygo.common.policy.traits`), shape
                (B, TRAIT_COUNT).
            remembered: From `remember`, for a network with a memory.
        """
        features = [latents, motion] if remembered is None else [latents, motion, remembered]
        if self.inputs.goal is not GoalForm.IMAGE:
            features.append((goal_xy_m / GOAL_SCALE_M).clamp(-1.0, 1.0))
        if self.inputs.robot:
            assert traits is not None
            features.append(traits * self.trait_factor + self.trait_offset)
        answers: Tensor = self.head(torch.cat(features, dim=1))
        return answers

    def decide(self, answers: Tensor, *, moves: bool = False) -> Tensor:
        """Actions of the head's answers: (v / v_max, w / w_max), not clipped, shape (B, 2).

        Args:
            answers: From `act`.
            moves: True for the best one that moves, of a network that chooses among commands.
        """
        if self.bins is None:
            return answers
        scores = answers if self.caution is None else weigh(answers, self.caution)
        return self.bins.mode(scores + self.bins.standing if moves else scores)

    def normalise_motion(self, motion: Tensor, traits: Tensor | None = None) -> Tensor:
        """Features of own motion in SI units -> numbers around [-1, 1]; traits as for `act`."""
        if self.inputs.robot:
            motion = motion * ((self.limits / self._limits_of(traits)) @ self.commands + 1 - self.commands.sum(dim=0))
        return motion * self.motion_scale

    def clip(self, normalised_actions: Tensor, traits: Tensor | None = None) -> Tensor:
        """Normalised actions -> v [m/s] in [v_min, v_max], w [rad/s] in +-w_max, as the exported graph answers them."""
        return normalised_actions.clamp(self.lowest, torch.ones_like(self.lowest)) * self._limits_of(traits)

    def driving_weights(self) -> dict[str, Tensor]:
        """Weights of encoder and head by name: what drives, without the head that reads humans."""
        return {name: value for name, value in self.state_dict().items() if not name.startswith("humans.")}

    def _limits_of(self, traits: Tensor | None) -> Tensor:
        """What commands are in units of, shape (2,) or (B, 2)."""
        if not self.inputs.robot:
            return self.limits
        assert traits is not None
        return traits[:, LIMITS_AT:]


def bins_of(config: NetworkConfig, robot: RobotConfig) -> Bins | None:
    """The grid of a network's actions, if it has one: of "weighed" ones that of `command_grid`."""
    if config.output == "regression":
        return None
    weighed = config.output == "weighed"
    v_bins, w_bins = (len(SPEED_SHARES), len(TURN_SHARES)) if weighed else (V_BINS, W_BINS)
    return Bins(v_bins, w_bins, backward_rows(robot, v_bins))


def weigh(answers: Tensor, caution: float) -> Tensor:
    """Scores of commands: how likely the expert is to choose them, less what they risk.

    Args:
        answers: Logits of the expert's choice, of meeting an obstacle and of meeting a human, shape (B, 3 N).
        caution: What a certain collision costs.

    Returns:
        Shape (B, N).
    """
    likely, obstacle, human = answers.chunk(3, dim=1)
    return likely.log_softmax(dim=1) - caution * (obstacle.sigmoid() + human.sigmoid())


def humans_head(latents_width: int) -> nn.Sequential:
    """Latents -> the nearest visible human: logit of presence, bearing [rad], logarithm of the distance [m]."""
    return nn.Sequential(nn.Linear(latents_width, HUMANS_WIDTH), nn.ReLU(), nn.Linear(HUMANS_WIDTH, 3))


def command_columns(inputs: PolicyInputs) -> Float64Array:
    """Where v and w executed last stand among the features of own motion: 1 there, else 0, shape (2, M)."""
    width = inputs.motion.width(inputs.frame_count)
    first = width - 2 if inputs.motion is MotionInput.POSES else 0
    return np.eye(2, width, first)


def motion_scale(inputs: PolicyInputs, robot: RobotConfig) -> list[float]:
    """Factors that bring the features of own motion to about [-1, 1]."""
    command = [1.0 / robot.v_max_mps, 1.0 / robot.w_max_radps]
    width = inputs.motion.width(inputs.frame_count)
    return [1.0] * (width - 2) + command if inputs.motion is MotionInput.POSES else [*command, 1.0]


def parameter_count(model: PolicyNet) -> int:
    """Trained numbers of what is exported."""
    parts = (model.encoder, model.head, model.memory)
    return sum(p.numel() for part in parts if part is not None for p in part.parameters())
