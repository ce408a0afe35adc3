"""What the network is shown of a batch, and how far its answers are off."""

from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
import torch
from torch import Tensor, nn

from readygo.common.arrays import AnyArray, Float16Array, Float32Array, Float64Array, Int64Array
from readygo.common.images.names import cameras_of
from readygo.common.policy.traits import LIMITS_AT
from readygo.common.robot import RobotConfig
from readygo.common.robot.command_grid import HUMAN, OBSTACLE, UNKNOWN_RISK, mirror_indices
from readygo.services.trainer.config import TrainConfig
from readygo.services.trainer.episodes import eyes_of, eyes_show
from readygo.services.trainer.frames import FrameCache
from readygo.services.trainer.goals import Goals, hindsight_goals, own_goals
from readygo.services.trainer.inputs import MotionInput
from readygo.services.trainer.light import light_on, lit
from readygo.services.trainer.looked import LookCache
from readygo.services.trainer.model import Bins
from readygo.services.trainer.motion import correct_for_turn, corrupt_previous, mirrored_motion, turn_motion, turn_world
from readygo.services.trainer.pooling import pooling_of
from readygo.services.trainer.pretrained import PretrainedEncoder
from readygo.services.trainer.samples import Batch, TrainingSamples, WindowTiming, chain_rows, make_batch
from readygo.services.trainer.views import BatchViews, draw_views, plain_view
from readygo.services.trainer.warps import RobotWarp, mirror_twins, show_frames

PREVIOUS_DROPOUT = 0.5
"""Probability that a training sample does not see the previous action (`motion` "command" only)."""
PREVIOUS_NOISE = 0.1
"""Standard deviation of the noise on the previous action in training, in units of its limits."""
YAW_GAIN_PER_S = 2.0
"""Turn rate that the policy learns against a yaw error [1/s]."""
LOOKED_AT_ONCE = 64
"""Samples that a pretrained encoder looks at together."""
Frames = FrameCache | LookCache
WARPS_KEPT = 256
"""Cameras of episodes that are kept."""
LEFT_RIGHT = np.array([1.0, -1.0], np.float32)


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """A batch as the network takes it."""

    images: Tensor
    """Distinct frames, shape (F, C, H, W), channels_last; or what a pretrained encoder has of each sample."""
    window: Tensor
    """Rows of `images` that each sample sees, its frames and then its goal, shape (B, 3) or (B, 4)."""
    motion: Tensor
    """Features of own motion in SI units, shape (B, M)."""
    goals_xy_m: Tensor
    """Goals in the robot's frame [m], shape (B, 2)."""
    traits: Tensor
    """Robot parameters, see `TrainingSamples.traits`, shape (B, TRAIT_COUNT)."""
    targets: Tensor
    """(v / v_max, w / w_max), shape (B, 2)."""
    risks: Tensor
    """Risks of commands, see `TrainingSamples.risks`, shape (B, C)."""
    humans: Tensor
    """The nearest visible human, see `TrainingSamples.humans`, shape (B, 3)."""
    chains: Tensor
    """Samples in chains, see `chain_rows`, shape (N, T)."""

    def to(self, device: torch.device) -> "Shown":
        """The batch on a device."""
        return Shown(**{name: getattr(self, name).to(device, non_blocking=True) for name in self.__dataclass_fields__})


class Objective:
    """Turns samples into what the network is shown, and its answers into a loss."""

    def __init__(
        self,
        robot: RobotConfig,
        config: TrainConfig,
        timing: WindowTiming,
        dtype: torch.dtype,
        encoder: PretrainedEncoder | None = None,
    ) -> None:
        """Prepare for a network.

        Args:
            robot: Whose cameras took the images.
            config: Settings of the training.
            timing: Which steps belong together.
            dtype: Type in which the network computes.
            encoder: Looks at images once, for a network that has it.
        """
        self._timing, self._dtype, self._encoder = timing, dtype, encoder
        self._sees, sampling = config.network.images, config.sampling
        # In a mirror other cameras would be on the robot's other side, or have another lens.
        mirrors = encoder is None and mirror_twins(robot, cameras_of(self._sees)) is not None
        self._config, self._mirrors = sampling, mirrors
        self._mirrored_commands = mirror_indices(robot)
        self._motion = MotionInput(config.network.motion)
        pooling = pooling_of(robot.camera, config.network.pooled_height_px)
        self._warp_of = lru_cache(WARPS_KEPT)(partial(RobotWarp, images=self._sees, pooling=pooling))
        self._eyes_of = lru_cache(WARPS_KEPT)(eyes_of)
        self._sees_goal = config.network.goal != "point"

    def training(self, table: TrainingSamples, frames: Frames, samples: Int64Array, rng: np.random.Generator) -> Shown:
        """Samples with random changes."""
        batch = make_batch(samples, table.first, self._timing)
        firsts, groups = np.unique(table.first[batch.frames], return_inverse=True)
        # Episodes that a policy drove show its own yaw errors already.
        view = draw_views(~table.by_policy[firsts], self._config, rng, mirrors=self._mirrors)
        rows = groups[batch.window[:, -1]]
        yaws_rad, mirrored = view.yaws_rad[rows], view.mirrored[rows][:, None]
        traits = table.traits[table.episode[samples]]
        chosen = hindsight_goals(table, samples, self._config.hindsight, rng, seen=self._sees_goal)
        goals = turn_world(chosen.xy_m, yaws_rad)
        motion = self._training_motion(turn_motion(table.motion[samples], yaws_rad), traits[:, LIMITS_AT:], rng)
        targets = correct_for_turn(table.targets[samples], yaws_rad, YAW_GAIN_PER_S, traits[:, LIMITS_AT + 1])
        poses = self._motion is MotionInput.POSES
        signs = mirrored_motion(motion.shape[1]) if poses else np.array([1, -1, 1], np.float32)
        # What a command leads to is told for the robot as it stood.
        risks = np.where(yaws_rad[:, None] != 0, UNKNOWN_RISK, table.risks[samples])
        humans = table.humans[samples] - np.stack([0 * yaws_rad, yaws_rad, 0 * yaws_rad], axis=1)
        for row in np.flatnonzero((humans[:, 0] > 0) & (yaws_rad != 0)).tolist():
            if not eyes_show(self._eyes_of(table.robots[table.episode[samples[row]]]), *humans[row, 1:].tolist()):
                # Another one may still be in view, which the samples do not say.
                humans[row] = np.nan
        images = self._shown(table, frames, batch, groups, view)
        if self._sees_goal:
            places, batch = with_goal_frames(batch, chosen)
            # Where the robot was turned to says nothing of what is seen at the goal.
            still = replace(view, yaws_rad=np.zeros_like(view.yaws_rad))
            assert isinstance(frames, FrameCache)
            there = self._images(table, frames, places, rows[first_of(chosen)], still)
            images = torch.cat([images, there])
        return self._network_inputs(
            images,
            batch,
            traits,
            motion=np.where(mirrored, motion * signs, motion),
            goals=np.where(mirrored, goals * LEFT_RIGHT, goals),
            targets=np.where(mirrored, targets * LEFT_RIGHT, targets),
            risks=np.where(mirrored, risks[:, self._mirrored_commands], risks),
            humans=np.where(mirrored, humans * np.array([1, -1, 1]), humans).astype(np.float32),
            first=table.first[samples],
        )

    def plain(self, table: TrainingSamples, frames: Frames, samples: Int64Array, *, withheld: bool = False) -> Shown:
        """Samples as they were recorded, the previous action withheld where asked for."""
        batch = make_batch(samples, table.first, self._timing)
        motion = table.motion[samples]
        if self._motion is MotionInput.COMMAND:
            motion = corrupt_previous(motion[:, -2:], np.zeros(2, np.float32), np.full(len(samples), withheld))
        groups = np.zeros(len(batch.frames), np.int64)
        goals = own_goals(table, samples)
        images = self._shown(table, frames, batch, groups, plain_view())
        if self._sees_goal:
            places, batch = with_goal_frames(batch, goals)
            assert isinstance(frames, FrameCache)
            there = self._images(table, frames, places, np.zeros(len(places), np.int64), plain_view())
            images = torch.cat([images, there])
        return self._network_inputs(
            images,
            batch,
            table.traits[table.episode[samples]],
            motion=motion,
            goals=goals.xy_m,
            targets=table.targets[samples],
            risks=table.risks[samples],
            humans=table.humans[samples],
            first=table.first[samples],
        )

    def answers(self, network: nn.Module, shown: Shown) -> tuple[Tensor, Tensor]:
        """What `PolicyNet.forward` answers to a batch, computed in the type that was chosen."""
        with torch.autocast(shown.images.device.type, torch.bfloat16, enabled=self._dtype is torch.bfloat16):
            answers: tuple[Tensor, Tensor] = network(
                shown.images, shown.window, shown.motion, shown.goals_xy_m, shown.traits, shown.chains
            )
        return answers

    def loss(self, network: nn.Module, bins: Bins | None, shown: Shown) -> Tensor:
        """The mean loss of a batch.

        Args:
            network: A `PolicyNet`, as it is or wrapped.
            bins: Its grid of actions, if it has one.
            shown: The batch.
        """
        answers, humans = self.answers(network, shown)
        if bins is None:
            loss = nn.functional.mse_loss(answers, shown.targets)
        else:
            choice = answers[:, : len(bins.centres)]
            loss = nn.functional.cross_entropy(choice, bins.weights(shown.targets))
            if choice.shape != answers.shape:
                loss = loss + self._config.risks_weight * risks_loss(answers[:, choice.shape[1] :], shown.risks)
        if self._config.humans_weight > 0:
            loss = loss + self._config.humans_weight * humans_loss(humans, shown.humans)
        return loss

    def _training_motion(self, motion: Float32Array, limits: Float64Array, rng: np.random.Generator) -> Float32Array:
        if self._motion is MotionInput.POSES:
            return motion
        noise = (PREVIOUS_NOISE * rng.normal(0.0, limits, (len(motion), 2))).astype(np.float32)
        return corrupt_previous(motion[:, -2:], noise, rng.random(len(motion)) < PREVIOUS_DROPOUT)

    def _shown(
        self, table: TrainingSamples, frames: Frames, batch: Batch, groups: Int64Array, view: BatchViews
    ) -> Tensor:
        """The distinct frames of a batch as `_images` gives them, or what a pretrained encoder has of its samples."""
        if isinstance(frames, LookCache):
            return torch.from_numpy(frames.get(table, batch.samples, self._look)).float()
        return self._images(table, frames, batch.frames, groups, view)

    def _look(self, table: TrainingSamples, frames: FrameCache, samples: Int64Array) -> Float16Array:
        """What the pretrained encoder has of samples, see `PretrainedEncoder.look`."""
        assert self._encoder is not None
        batch, device = make_batch(samples, table.first, self._timing), self._encoder.log_m.device
        images = torch.from_numpy(frames.get(table, batch.frames)).permute(0, 3, 1, 2)
        motion, looked = torch.from_numpy(table.motion[samples]), []
        for rows in range(0, len(samples), LOOKED_AT_ONCE):
            part = slice(rows, rows + LOOKED_AT_ONCE)
            stacked = images[torch.from_numpy(batch.window[part])].flatten(1, 2).float() / 127.5 - 1.0
            with torch.autocast(device.type, torch.bfloat16, enabled=self._dtype is torch.bfloat16):
                looked.append(self._encoder.look(stacked.to(device), motion[part].to(device)).half().cpu())
        told: Float16Array = torch.cat(looked).numpy()
        return told

    def _images(
        self, table: TrainingSamples, cache: FrameCache, places: Int64Array, groups: Int64Array, view: BatchViews
    ) -> Tensor:
        """Frames of some samples and images of goals, each episode's as its row of the view has it.

        Args:
            table: The samples.
            cache: Their frames.
            places: Samples, or -1 - e for the image of the goal of episode e, shape (F,).
            groups: Row of each one's episode in the view, shape (F,).
            view: How episodes are shown.
        """
        episodes = np.where(places < 0, -1 - places, table.episode[np.maximum(places, 0)])
        warps = {
            group: self._warp_of(table.robots[row])
            for group, row in zip(groups.tolist(), episodes.tolist(), strict=True)
        }
        shown, light = show_frames(cache.get(table, places), groups, view, warps), light_on(view.light, self._sees)
        if self._dtype is torch.bfloat16:
            # OpenCV knows no bfloat16: its bits travel as 16-bit numbers.
            bits = torch.from_numpy(light).to(torch.bfloat16).view(torch.int16).numpy()
            images = torch.from_numpy(lit(shown, groups, bits)).view(torch.bfloat16)
        else:
            images = torch.from_numpy(lit(shown, groups, light))
        return images.permute(0, 3, 1, 2)

    def _network_inputs(self, images: Tensor, batch: Batch, traits: Float64Array, **numbers: AnyArray) -> Shown:
        told = traits.astype(np.float32)
        return Shown(
            images=images,
            window=torch.from_numpy(batch.window),
            motion=torch.from_numpy(numbers["motion"]),
            goals_xy_m=torch.from_numpy(numbers["goals"]),
            traits=torch.from_numpy(told),
            targets=torch.from_numpy(numbers["targets"] / told[:, LIMITS_AT:]),
            risks=torch.from_numpy(numbers["risks"].astype(np.uint8)),
            humans=torch.from_numpy(numbers["humans"]),
            chains=torch.from_numpy(chain_rows(batch.samples, numbers["first"], self._timing.spacing_steps)),
        )


def with_goal_frames(batch: Batch, goals: Goals) -> tuple[Int64Array, Batch]:
    """The distinct frames that show goals, and a batch whose windows end with them, behind its own frames."""
    places, rows = np.unique(goals.seen_from, return_inverse=True)
    window = np.concatenate([batch.window, len(batch.frames) + rows.reshape(-1, 1)], axis=1)
    return places, replace(batch, window=window)


def first_of(goals: Goals) -> Int64Array:
    """A sample of the batch for each of the distinct places, in ascending order, that goals are seen from."""
    return np.asarray(np.unique(goals.seen_from, return_index=True)[1], np.int64)


def risks_loss(logits: Tensor, risks: Tensor) -> Tensor:
    """Binary cross-entropy of what commands lead to, over the samples that tell it.

    Args:
        logits: Of meeting an obstacle and of meeting a human, shape (B, 2 C).
        risks: See `TrainingSamples.risks`, shape (B, C).
    """
    known = risks[:, 0] != UNKNOWN_RISK
    if not known.any():
        return logits.sum() * 0.0
    truth = torch.cat([risks[known] == OBSTACLE, risks[known] == HUMAN], dim=1)
    return nn.functional.binary_cross_entropy_with_logits(logits[known], truth.to(logits.dtype))


def humans_loss(answers: Tensor, humans: Tensor) -> Tensor:
    """How far a reading of the nearest visible human is off: presence, then bearing and distance where there is one.

    Args:
        answers: Logit of presence, bearing [rad], logarithm of the distance [m], shape (B, 3).
        humans: See `TrainingSamples.humans`, shape (B, 3).
    """
    known = torch.isfinite(humans).all(dim=1)
    there = known & (torch.nan_to_num(humans[:, 0]) > 0.5)
    if not known.any():
        return answers.sum() * 0.0
    presence = nn.functional.binary_cross_entropy_with_logits(answers[known, 0], humans[known, 0])
    wanted = torch.stack([humans[there, 1], humans[there, 2].log()], dim=1)
    places = nn.functional.smooth_l1_loss(answers[there, 1:], wanted, reduction="sum", beta=0.1)
    return presence + places / known.sum()
