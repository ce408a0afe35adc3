"""The fit of a person: Gaussians on a body, its proportions, and the pose of every frame, by one drawn frame a step."""

from dataclasses import dataclass

import numpy as np
import torch

from readygo.common.arrays import BoolArray, Float32Array, Int64Array, UInt8Array
from readygo.common.avatars import Avatar
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.rig import BoneLengths, PosedSkeleton, Rig
from readygo.services.reconstructor.avatars.skinning import Skinned, skin_gaussians, skin_slopes
from readygo.services.reconstructor.avatars.surroundings import Surroundings
from readygo.services.reconstructor.avatars.trajectory import PoseTrajectory
from readygo.services.reconstructor.avatars.views import FilmedPerson, PersonView, view_at
from readygo.services.reconstructor.differentiable.autograd import Rendered, rasterize
from readygo.services.reconstructor.differentiable.order import spatial_order
from readygo.services.reconstructor.training.adam import Adam
from readygo.services.reconstructor.training.batches import batch_views
from readygo.services.reconstructor.training.config import DensityConfig
from readygo.services.reconstructor.training.density import Sightings, changed_density, limit_stretch
from readygo.services.reconstructor.training.parameters import Change, Gaussians
from readygo.services.reconstructor.training.photometric import SSIM_WEIGHT, Photometric
from readygo.services.reconstructor.training.photos import split_views

COARSE_UNTIL = ((0.3, 2),)
"""Images are smaller by a factor until a share of the steps."""
LENGTHS_UNTIL = 0.9
"""Proportions are fixed after this share of the steps."""
_CHANGE_EVERY, _CHANGE_BEGIN, _CHANGE_END = 100, 0.15, 0.7
_EXTENT_M = 1.0
"""What a person is measured by: Gaussians beyond 1 cm are split, and those beyond 10 cm removed."""
_SCALE_LIMITS_M = 0.0007, 0.03
_RATES = {
    "means_m": (2e-4, 1e-5),
    "quats_wxyz": (1e-3, 1e-3),
    "log_scales": (5e-3, 2e-3),
    "logits": (2e-2, 2e-2),
    "sh": (2e-2, 2e-3),
}
"""Learning rates of the Gaussians at the beginning and at the end."""
RIG_RATES = {
    "size": (4e-3, 2e-4),
    "bones": (4e-3, 3e-4),
    "offsets": (6e-4, 6e-5),
    "pose": (3e-2, 2e-3),
    "root": (3e-2, 2e-3),
}
_CONTACT_ROUNDS = 10
"""How often it is found which soles stand."""
_KEPT_BYTES = 1 << 30
"""Colours of frames that are kept at the present size; others are cut out each time."""
_OPACITY_BEGIN, _SCALE_BEGIN = 0.8, 0.75
"""Gaussians begin fainter and smaller than on the body: with soft edges all around, a body seems too large."""


@dataclass(eq=False)
class BoundGaussians:
    """Gaussians in training with their bonds to the skeleton."""

    gaussians: Gaussians
    joint: UInt8Array
    """Shape (N, 4)."""
    weight: Float32Array
    """Shape (N, 4)."""
    anchor_m: Float32Array
    """Where each began on the body [m], shape (N, 3)."""

    def apply(self, change: Change) -> "BoundGaussians":
        """What a change makes of them; copies have the bonds of what they are copied from."""
        source = change.source
        return BoundGaussians(
            self.gaussians.apply(change), self.joint[source], self.weight[source], self.anchor_m[source]
        )

    @classmethod
    def on_body(cls, body: Avatar) -> "BoundGaussians":
        """The Gaussians of a body, in spatial order."""
        order = spatial_order(body.cloud.means_m)
        cloud = body.cloud.select(order)
        opacity = np.full((len(cloud), 1), _OPACITY_BEGIN)
        gaussians = Gaussians.fresh(
            {
                "means_m": cloud.means_m,
                "quats_wxyz": cloud.quats_wxyz,
                "log_scales": np.log(_SCALE_BEGIN * cloud.scales_m),
                "logits": np.log(opacity / (1.0 - opacity)),
                "sh": cloud.sh[:, 0],
            }
        )
        joint, weight = np.ascontiguousarray(body.lbs_index[order]), np.ascontiguousarray(body.lbs_weight[order])
        return cls(gaussians, joint, weight, cloud.means_m.copy())


@dataclass(frozen=True, eq=False)
class Drawn:
    """A frame as it is drawn."""

    rendered: Rendered
    leaves: dict[str, torch.Tensor]
    skinned: Skinned
    posed: PosedSkeleton
    A: Float32Array
    B: Float32Array


class PersonFit:
    """A fit under way."""

    def __init__(
        self,
        body: Avatar,
        person: FilmedPerson,
        trajectory: PoseTrajectory,
        config: AvatarFitConfig,
        likely: BoneLengths | None = None,
        surroundings: Surroundings | None = None,
    ) -> None:
        """Begin on a body.

        Args:
            body: The first body.
            person: The film.
            trajectory: How the person moved.
            config: How.
            likely: The likeliest lengths of bones; None takes the body's.
            surroundings: The scene, which is then drawn with the person, and learned.
        """
        self.config, self.person, self.body, self.step = config, person, body, 0
        self.surroundings = surroundings
        self.bound = BoundGaussians.on_body(body)
        prior = config.prior
        self.rig = Rig(
            body,
            trajectory,
            prior.weight,
            likely,
            contact_weight=prior.contacts if prior.in_order else 0.0,
            contacts_every=max(1, config.steps // _CONTACT_ROUNDS),
        )
        self.likely_joints_m = self.rig.shaped_joints()[0]
        """Joints in the T-pose that it begins with [m], shape (24, 3)."""
        self.train, self.held = split_views(range(len(person)), config.hold_out)
        self.loss = float("nan")
        self._adam = Adam(config.steps, 1)
        self._seen = Sightings.none(len(self))
        self._views: dict[int, PersonView] = {}
        self._fraction = 0
        self._photometric: dict[tuple[int, int], Photometric] = {}

    def __len__(self) -> int:
        return len(self.bound.gaussians)

    def state(self) -> dict[str, Float32Array]:
        """All arrays by name, for a checkpoint."""
        bonds = {"joint": self.bound.joint, "weight": self.bound.weight, "anchor": self.bound.anchor_m}
        seen = {"seen_gradient": self._seen.gradient, "seen_views": self._seen.views}
        scene = {} if self.surroundings is None else self.surroundings.state()
        return {**self.bound.gaussians.state(), **bonds, **seen, **scene, **self.rig.state()}  # type: ignore[dict-item]

    def load(self, step: int, state: dict[str, Float32Array]) -> None:
        """Continue at a step with what `state` gave."""
        self.step = step
        self.bound = BoundGaussians(
            Gaussians.from_state(state),
            state["joint"].astype(np.uint8),
            state["weight"],
            state["anchor"],
        )
        self._seen = Sightings(state["seen_gradient"], state["seen_views"])
        self.rig.load(state)  # type: ignore[arg-type]
        if self.surroundings is not None:
            self.surroundings.load(state)

    def one_step(self) -> None:
        """Draw a frame, and change what it has a gradient of; in held-out frames the motion alone."""
        share = self.step / self.config.steps
        frame, view, rng = self._next_view(share)
        drawn = self.draw(frame, view, gradients=True)
        self._derive(frame, drawn.rendered, view, rng)
        rows, slopes = self._gaussian_slopes(drawn)
        held = frame in self.held
        names = ("pose", "root") if held or share > LENGTHS_UNTIL else tuple(RIG_RATES)
        rates = {name: between(RIG_RATES[name], share) for name in names if self.config.offsets or name != "offsets"}
        self.rig.step(drawn.posed, slopes.pop("A"), slopes.pop("B"), rates)
        if not held:
            self._change_gaussians(drawn, view, rows, slopes, share)
            self._change_scene(frame, drawn)
        self.step += 1

    def draw(self, frame: int, view: PersonView, *, gradients: bool = False, alone: bool = False) -> Drawn:
        """Draw a frame's person over black, with the surroundings if they are known, or alone."""
        posed = self.rig.pose(frame)
        A, B, quats = posed.arrays()
        values = self.bound.gaussians.values
        skinned = skin_gaussians(
            values["means_m"], values["quats_wxyz"], self.bound.joint, self.bound.weight, A, B, quats
        )
        arrays = {
            "means_m": skinned.means_m,
            "quats_wxyz": skinned.quats_wxyz,
            "scales_m": self.bound.gaussians.scales_m * np.float32(self.rig.size),
            "opacities": self.bound.gaussians.opacities,
            "sh": values["sh"].reshape(len(self), 1, 3),
        }
        features = None
        if self.surroundings is not None and not alone:
            around = self.surroundings.arrays(frame)
            arrays = {name: np.concatenate([array, around[name]]) for name, array in arrays.items()}
            features = person_feature(len(self), len(around["means_m"]))
        leaves = {name: torch.from_numpy(array).requires_grad_(gradients) for name, array in arrays.items()}
        rendered = rasterize(
            **leaves,
            features=features,
            T_world_camera=torch.from_numpy(view.T_world_camera),
            K_px=view.K_px,
            height_px=view.mask.shape[0],
            width_px=view.mask.shape[1],
            sh_degree=0,
            sparse_gradients=gradients,
            absolute_gradients=gradients,
        )
        return Drawn(rendered, leaves, skinned, posed, A, B)

    def seen(self) -> BoolArray:
        """Which Gaussians some frame of the film shows, shape (N,)."""
        seen = np.zeros(len(self), dtype=bool)
        for frame in self.train:
            drawn = self.draw(frame, view_at(self.person, frame, 2), gradients=True)
            shown = drawn.rendered.rows_shown(0.05)
            seen[shown[shown < len(self)]] = True
        return seen

    def _next_view(self, share: float) -> tuple[int, PersonView, np.random.Generator]:
        """The frame of this step, and its random numbers."""
        frame = batch_views(tuple(range(len(self.person))), self.step, 1, self.config.seed)[0]
        return frame, self._view(frame, fraction_at(share)), np.random.default_rng((self.config.seed, self.step))

    def _view(self, frame: int, fraction: int) -> PersonView:
        if fraction != self._fraction:
            self._views, self._fraction = {}, fraction
        view = self._views.get(frame) or view_at(self.person, frame, fraction)
        if len(self._views) * view.rgb.nbytes < _KEPT_BYTES:
            self._views[frame] = view
        return view

    def _derive(
        self,
        frame: int,
        rendered: Rendered,
        view: PersonView,
        rng: np.random.Generator,
        more: torch.Tensor | None = None,
    ) -> None:
        """The loss of a frame and what is added to it, and its gradients.

        With a plate the whole photo is compared, before it or with the surroundings. Without one the person alone, cut
        out by the mask, before a background of a random colour.
        """
        assert rendered.rgb is not None
        colour = rng.random(3, dtype=np.float32)[:, None, None]
        colours = rendered.rgb.detach().permute(2, 0, 1).contiguous().numpy()
        left = rendered.transmittance.detach().contiguous().numpy()
        size = view.mask.shape
        if size not in self._photometric:
            self._photometric[size] = Photometric(*size)
        if view.plate is None:
            background, photo = colour, view.rgb * view.mask + colour * (1.0 - view.mask)
        else:
            photo = view.rgb
            background = view.plate if self.surroundings is None else self.surroundings.background(frame)
        loss, _, slope = self._photometric[size](colours + left * background, photo, SSIM_WEIGHT)
        if view.plate is None:
            slope *= view.inner
        together = rendered.features
        covered = 1.0 - left if together is None else together.detach()[..., 0].numpy()
        difference = view.sure * (covered - view.mask)
        weight = np.float32(self.config.mask_weight / difference.size)
        by_covered, by_left = weight * np.sign(difference), (slope * background).sum(axis=0)
        self.loss = loss + float(weight * np.abs(difference).sum())
        images, slopes = [rendered.rgb, rendered.transmittance], [slope.transpose(1, 2, 0), by_left]
        if together is None:
            slopes[1] = by_left - by_covered
        else:
            images, slopes = [*images, together], [*slopes, by_covered[..., None]]
        added = [] if more is None else [more]
        torch.autograd.backward(  # type: ignore[no-untyped-call]
            [*images, *added],
            [*(torch.from_numpy(np.asarray(each, np.float32)) for each in slopes), *(None for _ in added)],
        )

    def _gaussian_slopes(self, drawn: Drawn) -> tuple[Int64Array, dict[str, Float32Array]]:
        """Derivatives by what is stored, for the rows that have one, and by the transforms."""
        gradients = {name: leaf.grad for name, leaf in drawn.leaves.items()}
        means = gradients["means_m"]
        if means is None:
            nothing = np.zeros((24, 3, 4), np.float32)
            return np.empty(0, np.int64), {"A": nothing, "B": nothing.copy()}
        rows: Int64Array = means._indices()[0].numpy()
        # The rows ascend; those of the surroundings come after the person's.
        rows = rows[: np.searchsorted(rows, len(self))]
        parts = {
            name: gradient._values().numpy()[: len(rows)]
            for name, gradient in gradients.items()
            if gradient is not None
        }
        bound, values = self.bound, self.bound.gaussians.values
        slopes = skin_slopes(
            rows, parts["means_m"], parts["quats_wxyz"], values["means_m"], bound.joint, bound.weight,
            drawn.A, drawn.B, drawn.skinned,
        )  # fmt: skip
        slope_of_needles: Float32Array | float = 0.0
        if self.config.isotropy > 0.0:
            shapes = torch.from_numpy(values["log_scales"][rows]).requires_grad_()
            (self.config.isotropy * needle_loss(shapes)).backward()  # type: ignore[no-untyped-call]
            assert shapes.grad is not None
            slope_of_needles = shapes.grad.numpy()
        scales, opacities = drawn.leaves["scales_m"].detach().numpy()[rows], bound.gaussians.opacities[rows]
        pull = np.float32(2.0 * self.config.anchor) * (values["means_m"][rows] - bound.anchor_m[rows])
        return rows, {
            "A": slopes.A,
            "B": slopes.B,
            "means_m": slopes.means_m + pull,
            "quats_wxyz": slopes.quats_wxyz,
            "log_scales": parts["scales_m"] * scales + slope_of_needles,
            "logits": (parts["opacities"] * opacities * (1.0 - opacities))[:, None],
            "sh": parts["sh"].reshape(len(rows), 3),
        }

    def _change_gaussians(
        self, drawn: Drawn, view: PersonView, rows: Int64Array, slopes: dict[str, Float32Array], share: float
    ) -> None:
        if not len(rows):
            return
        visible, (height, width) = drawn.rendered.visibility, view.mask.shape
        assert visible.absolute_gradient_px is not None
        assert visible.weight is not None
        kept = ((visible.weight > 0) & (visible.index < len(self))).numpy()
        moved = visible.absolute_gradient_px.numpy()[kept]
        self._seen.add(visible.index.numpy()[kept], np.hypot(moved[:, 0] * (0.5 * width), moved[:, 1] * (0.5 * height)))
        places = np.full((1, len(self)), -1, dtype=np.int32)
        places[0, rows] = np.arange(len(rows), dtype=np.int32)
        rates = {}
        for name, ends in _RATES.items():
            columns = self.bound.gaussians.values[name].shape[1]
            rates[name] = np.full(columns, between(ends, share), dtype=np.float32)
        self._adam.step(self.bound.gaussians, [slopes], places, rates, slice(0, len(self)))
        limit_stretch(self.bound.gaussians)
        log_scales = self.bound.gaussians.values["log_scales"]
        np.clip(log_scales, *np.log(_SCALE_LIMITS_M).astype(np.float32), out=log_scales)
        changes = (self.step + 1) % _CHANGE_EVERY == 0
        if changes and _CHANGE_BEGIN < share < _CHANGE_END:
            self._change_density()

    def _change_scene(self, frame: int, drawn: Drawn) -> None:
        by_opacities, by_sh = (drawn.leaves[name].grad for name in ("opacities", "sh"))
        if self.surroundings is None or by_opacities is None or by_sh is None:
            return
        rows: Int64Array = by_sh._indices()[0].numpy()
        first = int(np.searchsorted(rows, len(self)))
        slopes = by_opacities._values().numpy()[first:], by_sh._values().numpy()[first:, 0]
        self.surroundings.step(frame, rows[first:] - len(self), *slopes)

    def _change_density(self) -> None:
        density = DensityConfig(count_max=self.config.gaussians_max)
        rng = np.random.default_rng((self.config.seed, self.step, 1))
        change = changed_density(self.bound.gaussians.values, self._seen, density, _EXTENT_M, rng)
        self.bound = self.bound.apply(change)
        self._seen = Sightings.none(len(self))


def needle_loss(log_scales: torch.Tensor) -> torch.Tensor:
    """Sum of the squared logarithms of the longest axis relative to the middle one, for (N, 3) logarithms of scales.

    Flat Gaussians lie well on a surface; long ones stick out in other poses.
    """
    longest, middle = log_scales.topk(2, dim=1).values.unbind(dim=1)
    return (longest - middle).square().sum()


def person_feature(person: int, around: int) -> torch.Tensor:
    """A feature that is drawn as how much of a pixel shows the person: 1 for the person's Gaussians, 0 for others."""
    return torch.cat([torch.ones(person, 1), torch.zeros(around, 1)])


def fraction_at(share: float) -> int:
    """How many times smaller images are at a share of the steps."""
    return next((fraction for until, fraction in COARSE_UNTIL if share < until), 1)


def between(ends: tuple[float, float], share: float) -> float:
    """A value that falls from one end to the other, by the same factor in equal times."""
    return float(ends[0] * (ends[1] / ends[0]) ** share)
