"""The Gaussians that are trained, as arrays: their parameters and the state of the optimiser."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, FloatingArray, Int64Array, UInt8Array
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0

PARAMETERS = ("means_m", "quats_wxyz", "log_scales", "logits", "sh")
SHAPES = ("means_m", "quats_wxyz", "log_scales", "logits")
"""What decides where Gaussians are added and removed."""
_NEIGHBOURS = 3


@dataclass(eq=False)
class Gaussians:
    """N Gaussians in training."""

    values: dict[str, Float32Array]
    """Arrays by the names of PARAMETERS: shapes (N, 3), (N, 4), (N, 3), (N, 1) and (N, 3 K)."""
    first: dict[str, Float32Array]
    """Adam's means of the gradients."""
    second: dict[str, Float32Array]
    """Adam's means of their squares."""
    updates: Float32Array
    """How often each Gaussian was changed, shape (N,): Adam moves those alone that a step has seen."""

    def __len__(self) -> int:
        return len(self.updates)

    @classmethod
    def fresh(cls, values: Mapping[str, FloatingArray]) -> "Gaussians":
        """Gaussians that were never changed."""
        singles = {name: np.ascontiguousarray(values[name], dtype=np.float32) for name in PARAMETERS}
        zeros = [{name: np.zeros_like(value) for name, value in singles.items()} for _ in range(2)]
        return cls(singles, zeros[0], zeros[1], np.zeros(len(singles["logits"]), dtype=np.float32))

    @classmethod
    def of_cloud(cls, cloud: GaussianCloud) -> "Gaussians":
        """The inverse of `cloud`, but for opacities of 0 and 1, and never changed."""
        opacities = np.clip(cloud.opacities, 1e-6, 1.0 - 1e-6)
        return cls.fresh(
            {
                "means_m": cloud.means_m,
                "quats_wxyz": cloud.quats_wxyz,
                "log_scales": np.log(cloud.scales_m),
                "logits": np.log(opacities / (1.0 - opacities))[:, None],
                "sh": cloud.sh.reshape(len(cloud.means_m), -1),
            }
        )

    def select(self, index: Int64Array | BoolArray) -> "Gaussians":
        """Some of the Gaussians, with their state."""
        parts = [
            {name: np.ascontiguousarray(array[index]) for name, array in part.items()}
            for part in (self.values, self.first, self.second)
        ]
        return Gaussians(parts[0], parts[1], parts[2], self.updates[index])

    def apply(self, change: "Change") -> "Gaussians":
        """What a change makes of them."""
        values = {name: getattr(change, name) for name in SHAPES}
        values["sh"] = self.values["sh"][change.source]
        moments = [{name: array[change.source] for name, array in part.items()} for part in (self.first, self.second)]
        gaussians = Gaussians(values, moments[0], moments[1], self.updates[change.source])
        gaussians.forget(np.flatnonzero(change.fresh))
        return gaussians

    def forget(self, rows: Int64Array) -> None:
        """Reset the optimiser's state of some Gaussians."""
        for part in (self.first, self.second):
            for array in part.values():
                array[rows] = 0.0
        self.updates[rows] = 0.0

    @property
    def opacities(self) -> Float32Array:
        """Peak opacities, shape (N,)."""
        return opacities_of(self.values["logits"])

    @property
    def scales_m(self) -> Float32Array:
        """Standard deviations along the principal axes [m], shape (N, 3)."""
        return np.exp(self.values["log_scales"])

    def cloud(self) -> GaussianCloud:
        """The Gaussians as a scene holds them."""
        quats = self.values["quats_wxyz"]
        return GaussianCloud(
            means_m=self.values["means_m"],
            quats_wxyz=quats / np.linalg.norm(quats, axis=1, keepdims=True),
            scales_m=self.scales_m,
            opacities=self.opacities,
            sh=self.values["sh"].reshape(len(self), -1, 3),
        )

    def state(self) -> dict[str, Float32Array]:
        """All arrays by name, for a checkpoint."""
        parts = {"value": self.values, "first": self.first, "second": self.second}
        arrays = {f"{part}_{name}": arrays[name] for part, arrays in parts.items() for name in PARAMETERS}
        return {**arrays, "updates": self.updates}

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> "Gaussians":
        """The inverse of `state`."""
        parts = [{name: state[f"{part}_{name}"] for name in PARAMETERS} for part in ("value", "first", "second")]
        return cls(parts[0], parts[1], parts[2], state["updates"])


@dataclass(eq=False)
class Change:
    """M Gaussians that the present ones become."""

    source: Int64Array
    """Row of the present Gaussian whose colours and optimiser's state each one takes, shape (M,)."""
    fresh: BoolArray
    """True where the optimiser's state is reset, shape (M,)."""
    means_m: Float32Array
    """Positions [m], shape (M, 3)."""
    quats_wxyz: Float32Array
    """Rotations, shape (M, 4)."""
    log_scales: Float32Array
    """Logarithms of the scales in metres, shape (M, 3)."""
    logits: Float32Array
    """Logits of the opacities, shape (M, 1)."""

    def __len__(self) -> int:
        return len(self.source)

    @classmethod
    def none(cls, shapes: Mapping[str, Float32Array]) -> "Change":
        """The change that keeps all Gaussians: arrays by the names of SHAPES, which are copied."""
        count = len(shapes["logits"])
        arrays = {name: shapes[name].copy() for name in SHAPES}
        return cls(source=np.arange(count), fresh=np.zeros(count, dtype=bool), **arrays)

    def select(self, index: Int64Array | BoolArray) -> "Change":
        """The change with some of its Gaussians."""
        return Change(**{name: getattr(self, name)[index] for name in self.__dataclass_fields__})

    def join(self, other: "Change") -> "Change":
        """The change with these Gaussians, then those of another one."""
        names = self.__dataclass_fields__
        return Change(**{name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in names})

    @property
    def opacities(self) -> Float32Array:
        """Peak opacities, shape (M,)."""
        return opacities_of(self.logits)

    @property
    def scales_m(self) -> Float32Array:
        """Standard deviations along the principal axes [m], shape (M, 3)."""
        return np.exp(self.log_scales)


def opacities_of(logits: Float32Array) -> Float32Array:
    """Peak opacities, shape (N,) for (N, 1)."""
    opacities: Float32Array = np.float32(1) / (np.float32(1) + np.exp(-logits[:, 0]))
    return opacities


def initial_gaussians(points_m: Float64Array, rgb: UInt8Array, sh_degree: int, opacity: float) -> Gaussians:
    """A round Gaussian for each point, as large as its three neighbours are away (root mean square).

    Args:
        points_m: Shape (N, 3).
        rgb: Colours of the points, shape (N, 3).
        sh_degree: Of the spherical harmonics.
        opacity: Of all.
    """
    count = len(points_m)
    distances, _ = cKDTree(points_m).query(points_m, k=min(_NEIGHBOURS + 1, count))
    apart_m = np.sqrt(np.mean(np.square(distances[:, 1:]), axis=1))
    apart_m = np.clip(apart_m, 1e-7, np.quantile(apart_m, 0.99))
    sh = np.zeros((count, 3 * (sh_degree + 1) ** 2))
    sh[:, :3] = (rgb / 255.0 - 0.5) / SH_C0
    return Gaussians.fresh(
        {
            "means_m": points_m,
            "quats_wxyz": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
            "log_scales": np.repeat(np.log(apart_m)[:, None], 3, axis=1),
            "logits": np.full((count, 1), np.log(opacity / (1.0 - opacity))),
            "sh": sh,
        }
    )
