"""The `priormdm` motion source: a diffusion model draws the body's motion over a given ground path.

The path becomes the first three features of every frame, the model fills in the rest, joints are decoded and worn by
the body at hand. The pelvis is above the trajectory in every row.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch

from readygo.common.arrays import BoolArray, Float32Array, Float64Array
from readygo.common.errors import ConfigError
from readygo.common.maps.grid import FloorMap
from readygo.common.messages import Motion
from readygo.services.animator.gait.human import GaitSkeleton
from readygo.services.animator.gait.math import Ground, smooth
from readygo.services.animator.gait.path import check_trajectory, heading
from readygo.services.animator.priormdm.checkpoint import TrainedModel, load_model
from readygo.services.animator.priormdm.config import PriorMdmConfig
from readygo.services.animator.priormdm.diffusion import cosine_schedule, sample
from readygo.services.animator.priormdm.features import (
    FEATURE_COUNT,
    HEADING_SIGMA_FRAMES,
    PATH,
    Start,
    decode_joints,
    encode_path,
)
from readygo.services.animator.priormdm.placement import HUMANML3D_LEG_M, wear
from readygo.services.animator.priormdm.windows import WINDOW, PredictBatch, over_windows
from readygo.services.animator.smpl.fit import pose_of
from readygo.services.animator.smpl.refine import load_pose_prior, refine_in_place

GUIDANCE = 2.5
"""Weight of the text (classifier-free guidance), as in PriorMDM's release; 1 is the text alone."""
OVERLAP = 40
"""Frames that neighbouring windows share, for motions longer than a window."""
SETTLE_FRAMES = 20
"""Rows after the trajectory's end, in which the person comes to stand."""


class PriorMdm:
    """A loaded model that moves people along trajectories."""

    def __init__(self, model: TrainedModel, config: PriorMdmConfig) -> None:
        """Prepare sampling.

        Raises:
            ConfigError: If more steps are asked for than the model was trained with, or the pose prior is unusable.
        """
        self.model = model
        self.config = config
        self.prior = load_pose_prior(Path(config.pose_prior)) if config.refine == "prior" else None
        try:
            self.schedule = cosine_schedule(model.diffusion_steps, config.steps, sigma_small=model.sigma_small)
        except ValueError as error:
            raise ConfigError(f"priormdm.{error}") from error

    @classmethod
    def load(cls, config: PriorMdmConfig) -> "PriorMdm":
        """Load the user's files; see `load_model`."""
        return cls(load_model(config), config)

    def walk(
        self,
        skeleton: GaitSkeleton,
        trajectory_xy_m: Float64Array,
        floor: FloorMap,
        rng: np.random.Generator,
    ) -> Motion:
        """A person who goes along a trajectory; the counterpart of `readygo.services.animator.gait.walk.walk`.

        Args:
            skeleton: Measures of the body, see `skeleton_of`.
            trajectory_xy_m: Ground position at 20 Hz in the z-up world [m], shape (T, 2).
            floor: Height of the local floor.
            rng: Source of all chance.

        Returns:
            The motion, T + 20 rows: the pelvis above the trajectory, then above its end.

        Raises:
            MotionError: If the trajectory is empty, not finite, or jumps faster than 5 m/s.
            ConfigError: If the model's weights give numbers that are not finite.
        """
        xy = np.asarray(trajectory_xy_m, dtype=np.float64)
        check_trajectory(xy)
        rows = len(xy) + SETTLE_FRAMES
        features, start, scale = self._draw(xy, skeleton, rng, rows)
        grid = floor.frame
        heights = np.array(floor.height_m, order="C")
        ground = Ground(heights, float(grid.origin_x_m), float(grid.origin_y_m), float(grid.resolution_m))
        G, pelvis = wear(decode_joints(features, start) * scale, skeleton, ground)
        held = np.concatenate([xy, np.repeat(xy[-1:], SETTLE_FRAMES, axis=0)])
        root = np.concatenate([held, pelvis[:, 1:2]], axis=1)
        motion = Motion(root_m=root.astype(np.float32), pose_axis_angle=pose_of(G).astype(np.float32))
        if self.config.refine == "none":
            return motion
        with _one_thread():
            return refine_in_place(motion, skeleton.offsets_m, prior=self.prior)

    def _draw(
        self, xy: Float64Array, skeleton: GaitSkeleton, rng: np.random.Generator, rows: int
    ) -> tuple[Float64Array, Start, float]:
        """Features of the first rows, where they begin, and metres of the body per metre of HumanML3D's skeleton."""
        scale = skeleton.leg_m / HUMANML3D_LEG_M
        frames = max(rows, WINDOW)
        held = np.concatenate([xy, np.repeat(xy[-1:], frames + 1 - len(xy), axis=0)]) / scale
        x, z = np.ascontiguousarray(held[:, 0]), -held[:, 1]
        psi = smooth(heading(x * scale, z * scale, 2.0 * np.pi * rng.random()), HEADING_SIGMA_FRAMES)
        features = self.complete(encode_path(x, z, psi), rng, rows)
        return features[:rows], Start(float(x[0]), float(z[0]), float(psi[0])), scale

    def complete(self, path: Float64Array, rng: np.random.Generator, rows: int | None = None) -> Float64Array:
        """Features of a motion over a path.

        Args:
            path: The columns `PATH` of the features, shape (T, 3), T >= 196.
            rng: Source of all noise.
            rows: Frames that count; later ones are padding. None: all.

        Returns:
            Not normalised, shape (T, 263); the given columns as they were given.

        Raises:
            ConfigError: If the weights give numbers that are not finite.
        """
        model = self.model
        known = np.zeros((len(path), FEATURE_COUNT))
        known[:, PATH] = (path - model.mean[PATH]) / model.std[PATH]
        is_known = np.zeros(known.shape, np.bool_)
        is_known[:, PATH] = True
        # Models that saw padding as zeros get the path's continuation, a stand, in its place.
        valid = np.arange(len(path)) < (len(path) if rows is None else rows) if model.mask_frames else None
        predict = over_windows(self._predictor(valid), len(path), OVERLAP)
        with _one_thread():
            drawn = sample(predict, known, is_known, self.schedule, rng, sampler=self.config.sampler)
        if not np.isfinite(drawn).all():
            raise ConfigError(f"The model {self.config.weights} gives numbers that are not finite; check the weights.")
        features = drawn.astype(np.float64) * model.std + model.mean
        features[:, PATH] = path
        return features

    def _predictor(self, valid: BoolArray | None) -> PredictBatch:
        model, config = self.model, self.config
        # Padding exists in motions of one window only.
        mask = None if valid is None or valid.all() else torch.from_numpy(valid[None, :WINDOW]).to(config.device)
        text = None if model.text is None else torch.from_numpy(model.text[None]).to(config.device)

        def predict(windows: Float32Array, step: int) -> Float32Array:
            with torch.inference_mode():
                x = torch.from_numpy(windows).to(config.device)
                steps = torch.full((len(windows),), step, dtype=torch.int64, device=config.device)
                clean = model.network(x, steps, None, mask)
                if text is not None:
                    worded = model.network(x, steps, text.expand(len(windows), -1), mask)
                    clean = clean + GUIDANCE * (worded - clean)
                result: Float32Array = clean.float().cpu().numpy()
            return result

        return predict


def device_numeric_class(config: PriorMdmConfig) -> str:
    """What the bits of this source's motions depend on besides the run's own numeric class."""
    processor = torch.backends.cpu.get_cpu_capability() if config.device == "cpu" else torch.cuda.get_device_name()
    return f"torch-{torch.__version__} {config.device} {processor}".replace("  ", " ")


@contextmanager
def _one_thread() -> Iterator[None]:
    """Sums of one thread: their order, and so their bits, do not depend on the machine's cores."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
