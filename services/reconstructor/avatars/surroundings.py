"""The scene around a person who is filmed, in training: it is drawn with the person, by depth, and learned as well.

The Gaussians that the frames show keep their places and shapes. Colours and opacities are learned: a scene is
reconstructed from other photos, at another time, and has floaters. What stands before the person hides the person, as
in the photo: Gaussians that are at least `BEFORE_M` nearer than the pelvis. All others are behind the person. By the
depths of their centres large Gaussians of the floor would lie over the feet.

Legend: c_n(f) = colour of Gaussian n from the camera of frame f, as the scene has it; g_f, o_f = gain and offset of the
frame's photo (`plates`); r_n = what is learned of the colour, the same in all frames; l_n = logit of the opacity, a_n
where it began; w_c, w_l = weights of the priors.

    colour_n(f) = g_f (c_n(f) + r_n) + o_f,   prior = w_c |r_n|^2 + w_l (l_n - a_n)^2 for each Gaussian that is drawn

What is behind is drawn as many times as large and as far from the camera as it takes to be beyond the person, which
leaves its image as it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from readygo.common.arrays import Float32Array, Float64Array, Int64Array
from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.gaussians.spherical_harmonics import SH_C0, rgb_along, sh_of_rgb
from readygo.services.reconstructor.avatars.views import FilmedPerson
from readygo.services.reconstructor.differentiable.autograd import rasterize
from readygo.services.reconstructor.differentiable.order import spatial_order
from readygo.services.reconstructor.training.adam import Adam
from readygo.services.reconstructor.training.parameters import PARAMETERS, Gaussians

BEFORE_M = 0.6
"""What is nearer than the pelvis by this may hide the person: arms and steps reach less far [m]."""
_BEYOND_M = 1.2
"""Nothing of a person is so far behind the pelvis [m]."""
_NEAR_M = 0.1
_WEIGHT_MIN_PX = 0.01
"""Gaussians that cover less of a frame are not drawn there [px]."""
_COLOUR_RATE, _OPACITY_RATE = 2e-3, 1e-2
"""Learning rates of colours in 0..1 and of logits."""
_COLOUR_PULL, _OPACITY_PULL = 1e-4, 1e-6
"""Weights w_c and w_l of the priors."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Frame:
    """What a frame shows."""

    rows: Int64Array
    """Gaussians, ascending, shape (n,)."""
    position_m: Float32Array
    """Where the camera is, shape (3,)."""
    farther: Float32Array
    """How many times as far from the camera each is drawn, shape (n, 1)."""
    rgb: Float32Array
    """Their colours in the photo before anything is learned, shape (n, 3)."""
    gain: Float32Array
    """Shape (3,)."""
    offset: Float32Array
    """Shape (3,)."""


class Surroundings:
    """The Gaussians of a scene that a film shows, in training."""

    def __init__(self, clouds: Sequence[GaussianCloud], person: FilmedPerson, root_m: Float64Array, steps: int) -> None:
        """Find what each frame shows.

        Args:
            clouds: Gaussians of the scene, in the world of the film's cameras.
            person: The film, with plates of this scene.
            root_m: About where the pelvises are, in the world of the film's cameras [m], shape (F, 3).
            steps: At most so many steps are taken.
        """
        assert person.plate_colours is not None
        frames = []
        whole = concatenate([cloud.select(spatial_order(cloud.means_m)) for cloud in clouds])
        seen = [_rows_in_view(whole, person, number) for number in range(len(person))]
        kept = np.unique(np.concatenate(seen))
        cloud = whole.select(kept)
        for number, rows in enumerate(seen):
            gain, offset = person.plate_colours[number].astype(np.float32)
            own, T = np.searchsorted(kept, rows), person.T_world_camera[number]
            shown, position_m = cloud.select(own), T[:3, 3]
            rgb = gain * rgb_along(shown.sh, shown.means_m.astype(np.float64) - position_m) + offset
            frames.append(
                _Frame(
                    rows=own,
                    position_m=position_m.astype(np.float32),
                    farther=_farther(shown, T, root_m[number]),
                    rgb=rgb.astype(np.float32),
                    gain=gain,
                    offset=offset,
                )
            )
        self._frames = tuple(frames)
        self.gaussians = Gaussians.of_cloud(cloud)
        self.gaussians.values["sh"] = np.zeros((len(cloud), 3), dtype=np.float32)
        """`sh` holds what is learned of the colours, in 0..1."""
        for part in (self.gaussians.first, self.gaussians.second):
            part["sh"] = np.zeros((len(cloud), 3), dtype=np.float32)
        self._scales_m = cloud.scales_m
        self._logits = self.gaussians.values["logits"].copy()
        self._adam = Adam(steps, 1)

    def __len__(self) -> int:
        return len(self.gaussians)

    def state(self) -> dict[str, Float32Array]:
        """All arrays by name, for a checkpoint."""
        return {f"scene_{name}": array for name, array in self.gaussians.state().items()}

    def load(self, state: dict[str, Float32Array]) -> None:
        """The inverse of `state`."""
        own = {name.removeprefix("scene_"): array for name, array in state.items() if name.startswith("scene_")}
        self.gaussians = Gaussians.from_state(own)

    def background(self, frame: int) -> Float32Array:
        """Colour behind the scene in a frame's photo, shape (3, 1, 1): black, as the photo's offset shows it."""
        return self._frames[frame].offset[:, None, None]

    def arrays(self, frame: int) -> dict[str, Float32Array]:
        """What a frame shows, as the rasterizer takes it: n Gaussians, `sh` of degree 0."""
        shown, values = self._frames[frame], self.gaussians.values
        rgb = shown.rgb + shown.gain * values["sh"][shown.rows]
        away_m = values["means_m"][shown.rows] - shown.position_m
        return {
            "means_m": shown.position_m + shown.farther * away_m,
            "quats_wxyz": values["quats_wxyz"][shown.rows],
            "scales_m": shown.farther * self._scales_m[shown.rows],
            "opacities": self.gaussians.opacities[shown.rows],
            "sh": sh_of_rgb(rgb).astype(np.float32)[:, None],
        }

    def step(self, frame: int, rows: Int64Array, by_opacities: Float32Array, by_sh: Float32Array) -> None:
        """Change colours and opacities by the derivatives of a loss by some of what `arrays` gave.

        Args:
            frame: The frame.
            rows: Which of the n Gaussians, shape (k,).
            by_opacities: Derivatives by the opacities, shape (k,).
            by_sh: Derivatives by the coefficients of degree 0, shape (k, 3).
        """
        if not len(rows):
            return
        shown, values = self._frames[frame], self.gaussians.values
        own = shown.rows[rows]
        opacities = self.gaussians.opacities[own]
        slopes = {name: np.zeros((len(own), values[name].shape[1]), np.float32) for name in PARAMETERS}
        slopes["sh"] = by_sh * shown.gain / np.float32(SH_C0) + np.float32(2 * _COLOUR_PULL) * values["sh"][own]
        moved = values["logits"][own] - self._logits[own]
        slopes["logits"] = (by_opacities * opacities * (1 - opacities))[:, None] + np.float32(2 * _OPACITY_PULL) * moved
        places = np.full((1, len(self)), -1, dtype=np.int32)
        places[0, own] = np.arange(len(own), dtype=np.int32)
        rates = {name: np.zeros(values[name].shape[1], np.float32) for name in PARAMETERS}
        rates["sh"] += np.float32(_COLOUR_RATE)
        rates["logits"] += np.float32(_OPACITY_RATE)
        self._adam.step(self.gaussians, [slopes], places, rates, slice(0, len(self)))


def _rows_in_view(cloud: GaussianCloud, person: FilmedPerson, number: int) -> Int64Array:
    """Gaussians that a frame would show without the person, ascending."""
    arrays = (cloud.means_m, cloud.quats_wxyz, cloud.scales_m, cloud.opacities)
    height, width = person.mask[number].shape
    rendered = rasterize(
        *(torch.from_numpy(np.ascontiguousarray(array)).requires_grad_() for array in arrays),
        T_world_camera=torch.from_numpy(person.T_world_camera[number]),
        K_px=person.K_px[number],
        height_px=height,
        width_px=width,
        sparse_gradients=True,
    )
    return rendered.rows_shown(_WEIGHT_MIN_PX)


def _farther(cloud: GaussianCloud, T_world_camera: Float64Array, root_m: Float64Array) -> Float32Array:
    """How many times as far from the camera Gaussians (N, 1) are drawn: 1 before the person, else beyond the person."""
    depth_m = (cloud.means_m - T_world_camera[:3, 3]) @ T_world_camera[:3, 2]
    person_m = float((root_m - T_world_camera[:3, 3]) @ T_world_camera[:3, 2])
    front_m = max(person_m - BEFORE_M, _NEAR_M)
    factor = max((person_m + _BEYOND_M) / front_m, 1.0)
    farther: Float32Array = np.where(depth_m < front_m, 1.0, factor).astype(np.float32)[:, None]
    return farther
