"""Training on a GPU: gsplat draws and derives, torch does the rest. The losses and rules are those of the CPU.

Where Gaussians are added and removed is found on the CPU, every `density.every` steps. Sums of gradients come in
another order each time, so two runs differ in their last digits, and soon in more.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from readygo.common.arrays import AnyArray, Float32Array, Float64Array, Int64Array
from readygo.common.rasterizer.gpu.availability import require_kernels
from readygo.common.rasterizer.gpu.gsplat_kernels import Rasterization, gsplat_rasterization
from readygo.services.reconstructor.differentiable.reference import colours_along, rotations
from readygo.services.reconstructor.training.adam import EPSILON, Adam
from readygo.services.reconstructor.training.config import GaussiansConfig
from readygo.services.reconstructor.training.density import NOISE_OPACITY, NOISE_SLOPE, REGULAR, STRETCH_MAX, Sightings
from readygo.services.reconstructor.training.engine import ViewLoss, ViewTask
from readygo.services.reconstructor.training.gsplat_values import Blended, blend_values
from readygo.services.reconstructor.training.parameters import PARAMETERS, SHAPES, Change, Gaussians
from readygo.services.reconstructor.training.photometric import SSIM_WEIGHT, photometric_loss
from readygo.services.reconstructor.training.photos import BRIGHTNESS, PhotoStore
from readygo.services.reconstructor.training.planes import plane_features
from readygo.services.reconstructor.training.surfaces import between, normals_within, off_measured, side_of

Tensor = torch.Tensor
Tensors = dict[str, Tensor]


def cuda_engine(settings: GaussiansConfig) -> "CudaEngine":
    """The engine on the first CUDA device.

    Raises:
        ReadygoError: If gsplat, a GPU or a compiler is missing.
    """
    require_kernels("gsplat", "cuda")
    return CudaEngine(settings, torch.device("cuda"), gsplat_rasterization())


@dataclass(frozen=True, kw_only=True, eq=False)
class _View:
    """A photo on the device, and its camera."""

    pixels: Tensor
    """Colours, uint8, shape (3, H, W)."""
    mask: Tensor | None
    """True where the photo counts, shape (H, W); None where all of it does."""
    depth_m: Tensor | None
    """Depths that the device measured, 0 where it did not, shape (H, W); None without any."""
    K_px: Float64Array
    T_world_camera: Float64Array

    @property
    def size_px(self) -> tuple[int, int]:
        """Rows and columns [px]."""
        return self.pixels.shape[1], self.pixels.shape[2]

    @property
    def camera_m(self) -> Tensor:
        """Position of the camera [m], shape (3,)."""
        return torch.tensor(self.T_world_camera[:3, 3], dtype=torch.float32, device=self.pixels.device)


class CudaEngine:
    """Trains with gsplat; see `engine.Engine`.

    Args:
        settings: How.
        device: Where the Gaussians and photos are.
        rasterization: `gsplat.rasterization`, or what stands in for it.
    """

    def __init__(self, settings: GaussiansConfig, device: torch.device, rasterization: Rasterization) -> None:
        self._settings, self._device, self._rasterization = settings, device, rasterization
        self._adam = Adam(settings.steps, settings.batch)
        self._corrections = torch.tensor(self._adam.corrections, device=device)
        self._store: PhotoStore | None = None
        self._kept: dict[int, _View] = {}

    def load(self, gaussians: Gaussians, seen: Sightings) -> None:
        """Continue with other Gaussians."""
        self._values, self._first, self._second = (
            {name: self._on_device(array) for name, array in part.items()}
            for part in (gaussians.values, gaussians.first, gaussians.second)
        )
        self._updates, self._gradient, self._views = (
            self._on_device(array) for array in (gaussians.updates, seen.gradient, seen.views)
        )
        for value in self._values.values():
            value.requires_grad_()

    def arrays(self) -> tuple[Gaussians, Sightings]:
        """Copies of what it holds."""
        values, first, second = (
            {name: _array(tensor) for name, tensor in part.items()}
            for part in (self._values, self._first, self._second)
        )
        seen = Sightings(_array(self._gradient), _array(self._views))
        return Gaussians(values, first, second, _array(self._updates)), seen

    def shapes(self) -> tuple[dict[str, Float32Array], Sightings]:
        """Copies of what decides where Gaussians are added and removed."""
        arrays = {name: _array(self._values[name]) for name in SHAPES}
        return arrays, Sightings(_array(self._gradient), _array(self._views))

    @torch.no_grad()
    def rebuild(self, change: Change) -> None:
        """Continue with the Gaussians after a change, without views; colours and moments stay on the device."""
        source, kept = torch.from_numpy(change.source).to(self._device), self._on_device(~change.fresh)
        self._values = {
            **{name: self._on_device(getattr(change, name)) for name in SHAPES},
            "sh": self._values["sh"].detach()[source],
        }
        for value in self._values.values():
            value.requires_grad_()
        for part in (self._first, self._second):
            for name in PARAMETERS:
                part[name] = part[name][source] * kept[:, None]
        self._updates = self._updates[source] * kept
        self._gradient, self._views = torch.zeros_like(self._updates), torch.zeros_like(self._updates)

    def not_finite(self) -> str | None:
        """A parameter that has a number that is not finite."""
        return next((name for name, value in self._values.items() if not bool(value.isfinite().all())), None)

    def __len__(self) -> int:
        """Number of Gaussians."""
        return len(self._updates)

    def views(self, photos: PhotoStore, tasks: Sequence[ViewTask], sh_degree: int) -> list[ViewLoss]:
        """Losses of the views of a step; their gradients are kept for `change`."""
        self._used = torch.zeros(len(self), dtype=torch.bool, device=self._device)
        for value in self._values.values():
            value.grad = torch.zeros_like(value)
        return [self._one_view(photos, task, sh_degree) for task in tasks]

    @torch.no_grad()
    def change(self, rates: dict[str, Float32Array]) -> None:
        """Take the step that the last views want: Adam for the Gaussians that they have seen."""
        used = self._used[:, None].float()
        self._updates += used[:, 0]
        pace = self._corrections[self._updates.long()][:, None] * used * self._adam.rate
        beta1, beta2 = self._adam.betas
        for name in PARAMETERS:
            value, first, second = self._values[name], self._first[name], self._second[name]
            gradient = value.grad
            assert gradient is not None
            first.lerp_(gradient, (1.0 - beta1) * used)
            second.lerp_(gradient.square(), (1.0 - beta2) * used)
            value -= pace * self._on_device(rates[name]) * first / (second.sqrt() + EPSILON)
        log_scales = self._values["log_scales"]
        longest = log_scales.median(dim=1, keepdim=True).values + float(np.log(STRETCH_MAX))
        log_scales.copy_(torch.minimum(log_scales, longest))

    @torch.no_grad()
    def add_noise(self, size_m: float, rng: np.random.Generator) -> None:
        """Move faint Gaussians at random; see `density.add_noise`."""
        generator = torch.Generator(self._device).manual_seed(int(rng.integers(1 << 62)))
        noise = torch.randn((len(self), 3, 1), generator=generator, device=self._device)
        opacities = torch.sigmoid(self._values["logits"])
        strength = size_m * torch.sigmoid(-NOISE_SLOPE * (opacities - NOISE_OPACITY))
        axes = rotations(self._values["quats_wxyz"]) * torch.exp(self._values["log_scales"])[:, None]
        self._values["means_m"] += (axes @ (axes.mT @ noise))[..., 0] * strength

    def seen_by(self, photos: PhotoStore, groups: Sequence[Sequence[int]], pixels_min: float) -> Int64Array:
        """In how many of these groups a view has each Gaussian on more than so many pixels, shape (N,)."""
        found = torch.zeros(len(self), dtype=torch.int64, device=self._device)
        shapes = {name: value.detach() for name, value in self._values.items()}
        nothing = shapes["means_m"][:, :0]
        for group in groups:
            shown = torch.zeros(len(self), dtype=torch.bool, device=self._device)
            for number in group:
                drawn = self._draw(shapes, self._view(photos, number), nothing)
                drawn.nothing.backward()  # type: ignore[no-untyped-call]
                shown |= drawn.weight > pixels_min
            found += shown
        counts: Int64Array = found.cpu().numpy()
        return counts

    @property
    def gpu_bytes(self) -> int:
        """Most memory of the GPU that tensors held at once."""
        return torch.cuda.max_memory_allocated(self._device) if self._device.type == "cuda" else 0

    def close(self) -> None:
        """Release the photos."""
        self._store, self._kept = None, {}

    def _one_view(self, photos: PhotoStore, task: ViewTask, sh_degree: int) -> ViewLoss:
        view = self._view(photos, task.number)
        rgb = view.pixels * float(BRIGHTNESS)
        exposure = torch.tensor(task.exposure, device=self._device, requires_grad=True)
        values = self._values
        sh = values["sh"].reshape(len(self), -1, 3)
        columns = [colours_along(sh, values["means_m"] - view.camera_m, sh_degree)]
        if task.rng is not None:
            columns.append(self._planes(view))
        drawn = self._draw(values, view, torch.cat(columns, dim=1), absolute=self._settings.density.needs_absolute)
        shown = drawn.values[..., :3].permute(2, 0, 1)
        image = shown * exposure[0, :, None, None].exp() + exposure[1, :, None, None]
        mask = view.mask
        if mask is not None:
            # What is ignored shows what is drawn there, without a derivative.
            rgb, image = (torch.where(mask, each, image.detach()) for each in (rgb, image))
        loss = photometric_loss(image, rgb, SSIM_WEIGHT)
        nothing, other = drawn.nothing, None
        if task.rng is not None:
            rgb = view.pixels * float(BRIGHTNESS)
            side = side_of(drawn.values[..., 3:], rgb, view.K_px, view.T_world_camera, mask)
            loss = loss + normals_within(side, drawn.alpha, rgb, self._settings.geometry)
            if view.depth_m is not None:
                loss = loss + off_measured(side, view.depth_m, self._settings.geometry)
            if task.neighbour is not None:
                there = self._view(photos, task.neighbour)
                other = self._draw(values, there, self._planes(there))
                there_rgb = there.pixels * float(BRIGHTNESS)
                other_side = side_of(other.values, there_rgb, there.K_px, there.T_world_camera, there.mask)
                loss = loss + between(side, other_side, self._settings.geometry, task.rng)
                nothing = nothing + other.nothing
        (loss + nothing).backward()  # type: ignore[no-untyped-call]
        self._note(view, drawn, other)
        assert exposure.grad is not None
        return ViewLoss(loss=float(loss.detach()), exposure=_array(exposure.grad))

    @torch.no_grad()
    def _note(self, view: _View, drawn: Blended, other: Blended | None) -> None:
        """Note which Gaussians a view shows, and the gradients of their projected means."""
        shown = drawn.weight > 0
        self._used |= shown if other is None else shown | (other.weight > 0)
        height, width = view.size_px
        u, v = drawn.gradient_px(absolute=self._settings.density.needs_absolute).unbind(1)
        # For an image of 2x2 units.
        self._gradient += torch.where(shown, torch.hypot(0.5 * width * u, 0.5 * height * v), 0.0)
        self._views += shown
        self._add_regular(shown)

    def _add_regular(self, shown: Tensor) -> None:
        """Losses of the Gaussians alone: faint and small ones for MCMC, flat ones for surfaces."""
        density, geometry = self._settings.density, self._settings.geometry
        log_scales, logits = self._values["log_scales"], self._values["logits"]
        assert log_scales.grad is not None
        assert logits.grad is not None
        here = shown[:, None].float()
        if density.method == "mcmc":
            opacities, regular = torch.sigmoid(logits), REGULAR / len(self)
            logits.grad += here * regular * opacities * (1.0 - opacities)
            log_scales.grad += here * (regular / 3.0) * log_scales.exp()
        if geometry.enabled:
            shortest, number = log_scales.min(dim=1, keepdim=True)
            share = geometry.flatten / shown.sum().clamp(min=1)
            log_scales.grad.scatter_add_(1, number, here * share * shortest.exp())

    def _planes(self, view: _View) -> Tensor:
        """Planes of the Gaussians as a view blends them, shape (N, 4)."""
        values = self._values
        scales_m = values["log_scales"].detach().exp()
        return plane_features(values["means_m"], values["quats_wxyz"], scales_m, view.camera_m)

    def _draw(self, shapes: Tensors, view: _View, values: Tensor, *, absolute: bool = False) -> Blended:
        return blend_values(
            self._rasterization,
            means_m=shapes["means_m"],
            quats_wxyz=shapes["quats_wxyz"],
            scales_m=shapes["log_scales"].exp(),
            opacities=torch.sigmoid(shapes["logits"])[:, 0],
            values=values,
            T_world_camera=view.T_world_camera,
            K_px=view.K_px,
            size_px=view.size_px,
            absolute=absolute,
        )

    def _view(self, photos: PhotoStore, number: int) -> _View:
        """A photo on the device; kept there if the store keeps its photos."""
        if photos is not self._store:
            self._store, self._kept = photos, {}
        if number in self._kept:
            return self._kept[number]
        pixels = torch.from_numpy(photos.pixels(number)).to(self._device).permute(2, 0, 1).contiguous()
        K, T = photos.camera(number, (pixels.shape[1], pixels.shape[2]))
        mask, depth_m = (
            None if array is None else torch.from_numpy(array).to(self._device)
            for array in (photos.mask(number), photos.depth_m(number))
        )
        view = _View(pixels=pixels, mask=mask, depth_m=depth_m, K_px=K, T_world_camera=T)
        if photos.keeps:
            self._kept[number] = view
        return view

    def _on_device(self, array: AnyArray) -> Tensor:
        return torch.tensor(array, device=self._device)


def _array(tensor: Tensor) -> Float32Array:
    """Copy of a tensor as a NumPy array."""
    array: Float32Array = tensor.detach().to("cpu", copy=True).numpy()
    return array
