"""What a Gaussian file holds, before anything is known of it: extents, which way may be up, how long a unit may be.

All lengths are in units of the file, all directions in its axes, so that nothing has to be right for it to be seen.
"""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.errors import NoGroundError
from readygo.common.frames import matrix_from_quat
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.transform import R_UP, R_from_up

OPACITY_MIN = 0.3
"""Fainter Gaussians show no surface."""
FLAT_RATIO = 0.5
"""A Gaussian is flat if its thinnest axis is at most this part of the next one."""
SAMPLES_MAX = 200_000
"""Gaussians that are looked at; of larger files, evenly many of all parts."""
LYING_COS = 0.94
"""A flat Gaussian lies in a plane whose normal is within 20 deg of the Gaussian's normal."""
LEVELS = 200
"""Slices, along a direction, that planes are looked for in."""
PLANE_RATIO_MIN = 0.4
"""A plane has at least this part of the support of the strongest one along its direction."""
SAME_DEG, AXIS_DEG = 12.0, 2.0
"""Directions nearer than the first are one candidate; nearer than the second to an axis they are called by it [deg]."""
UP_OF_CAMERAS = "cameras"
"""What `--up` calls the mean up of the cameras that a scene was filmed with."""
HELD_DEG = 25.0
"""The floor's normal is no farther from the mean up of the cameras, which are held by hand [deg]."""
CLEAR_RATIO = 1.4
"""The best candidate for up is clear if its score is this many times the next one's."""
LIKELY_RATIO = 0.25
"""Candidates of at least this part of the best one's score are worth a look."""
SCORE_MIN = 0.002
"""Weaker candidates are none at all."""
ABOVE_MIN = 0.7
"""A plane with a smaller share of the Gaussians above it goes through the middle of something."""
CLOSED_MAX = 0.1
"""A plane with a smaller share of the Gaussians above it may be a ceiling."""
ROOM_HEIGHT_M = 2.5
UNITS_M = {"metres": 1.0, "feet": 0.3048, "inches": 0.0254, "centimetres": 0.01, "millimetres": 0.001}
ROOM_HEIGHTS_M = (2.1, 6.0)
SIZES_M = (4.0, 1000.0)
"""Plausible heights of rooms and widths of places [m]."""
SCALE_RATIO = 1.5
"""Scales that differ by less are the same guess."""
DETAIL_M = 0.03
"""Usual size of the Gaussians of a place that was filmed at arm's length to some metres; a rough guide [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class UpCandidate:
    """A direction that may be up, and the floor that it would have."""

    name: str
    """Name of the direction, as `--up` takes it: an axis such as -y, or three numbers."""
    up: Float64Array
    """Unit vector that points up, in the file's axes, shape (3,)."""
    floor: float
    """Coordinate of the floor along `up`, in the file's units."""
    support: float
    """Share of all flat surface that lies in the floor, 0..1."""
    above: float
    """Share of the Gaussians that are not below the floor, 0..1."""
    standing: float
    """Share of what is between floor and top that is in the lower half, 0..1: furniture stands, lamps hang."""
    levels: tuple[float, ...]
    """Other planes above the floor, along `up`."""
    ceiling: float | None
    """Height of the room above the floor, where a plane closes it."""

    @property
    def score(self) -> float:
        """How much speaks for it, 0..1."""
        return self.support * self.standing**2 * (2.0 * self.above - 1.0) if self.above >= ABOVE_MIN else 0.0


@dataclass(frozen=True, kw_only=True)
class ScaleCandidate:
    """Metres per unit of the file, and why."""

    metres_per_unit: float
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Survey:
    """What is found in a file."""

    gaussians: int
    low: Float64Array
    """Along each axis, 1 % of the Gaussians are below, shape (3,)."""
    high: Float64Array
    """Along each axis, 1 % of the Gaussians are above, shape (3,)."""
    ups: tuple[UpCandidate, ...]
    """Directions that may be up, best first."""
    scales: tuple[ScaleCandidate, ...]
    """Possible scales, most telling first."""

    @property
    def likely_ups(self) -> tuple[UpCandidate, ...]:
        """The candidates that are not far behind the best one, three at most."""
        return tuple(up for up in self.ups[:3] if up.score >= LIKELY_RATIO * self.ups[0].score)

    @property
    def clear_up(self) -> UpCandidate | None:
        """The direction that is up beyond doubt, or None."""
        if not self.ups or self.ups[0].score < SCORE_MIN:
            return None
        second = self.ups[1].score if len(self.ups) > 1 else 0.0
        return self.ups[0] if self.ups[0].score >= CLEAR_RATIO * second else None

    def up_near(self, held: Float64Array) -> UpCandidate | None:
        """The best candidate near the mean up of cameras, shape (3,), or None: level as cameras were held by hand."""
        near = (up for up in self.ups if up.up @ held > math.cos(math.radians(HELD_DEG)) and up.score >= SCORE_MIN)
        return next(near, None)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Flat:
    """The flat ones among the sampled Gaussians, and all of them."""

    means: Float64Array
    normals: Float64Array
    areas: Float64Array
    all_means: Float64Array


def survey(cloud: GaussianCloud) -> Survey:
    """Look at a cloud in any axes and units; numbers must be finite, rotations of length 1."""
    stride = -(-len(cloud) // SAMPLES_MAX)
    flat = _flat(cloud.select(np.arange(0, len(cloud), stride)))
    low, high = np.quantile(flat.all_means, [0.01, 0.99], axis=0)
    ups = sorted((_candidate(flat, up) for up in _directions(flat)), key=lambda up: -up.score)
    return Survey(
        gaussians=len(cloud),
        low=low,
        high=high,
        ups=tuple(up for up in ups if up.score > 0),
        scales=_scales(ups[0], high - low, float(np.median(cloud.scales_m.max(axis=1)))),
    )


def resolve_up(up: str, load: Callable[[], GaussianCloud], held: Float64Array | None = None) -> str:
    """The up direction by name; "auto" is looked for in the cloud, which is only read for that.

    Args:
        up: As `--up` takes it; "cameras" is `held`, which then must be known.
        load: Gives the cloud.
        held: Up as its cameras were held, shape (3,): "auto" is the floor near that, or else that itself.

    Raises:
        NoGroundError: If it is to be found and is not clear.
    """
    if up == UP_OF_CAMERAS and held is not None:
        return up_name(held)
    if up != "auto":
        return up
    found = survey(load())
    if held is not None:
        near = found.up_near(held)
        return up_name(held) if near is None else near.name
    if found.clear_up is None:
        names = ", ".join(candidate.name for candidate in found.ups[:3]) or "none"
        raise NoGroundError(f"No direction of the scene is clearly up (candidates: {names}).")
    return found.clear_up.name


def _flat(cloud: GaussianCloud) -> _Flat:
    visible = cloud.select(cloud.opacities >= OPACITY_MIN)
    visible = visible if len(visible) else cloud
    scales = np.sort(visible.scales_m.astype(np.float64), axis=1)
    flat = scales[:, 0] <= FLAT_RATIO * scales[:, 1]
    # A few huge ones must not outvote all others.
    sizes = np.minimum(scales[:, 1:], np.quantile(scales[:, 2], 0.98))
    thin = visible.scales_m.argmin(axis=1)
    return _Flat(
        means=visible.means_m[flat].astype(np.float64),
        normals=matrix_from_quat(visible.quats_wxyz)[np.arange(len(thin)), :, thin][flat],
        areas=(sizes[:, 0] * sizes[:, 1] * visible.opacities.astype(np.float64))[flat],
        all_means=visible.means_m.astype(np.float64),
    )


def _directions(flat: _Flat) -> list[Float64Array]:
    """The normals that most surface has, and the axes, each with its opposite."""
    axes = [np.eye(3)[axis] for axis in range(3)]
    seeds = [_refine_normal(flat, seed) for seed in axes]
    rest = np.ones(len(flat.normals), np.bool_)
    for _ in range(3):
        if not rest.any():
            break
        seeds.append(_refine_normal(flat, flat.normals[rest][np.argmax(_votes(flat, flat.normals[rest]))]))
        rest &= np.abs(flat.normals @ seeds[-1]) < LYING_COS
    kept: list[Float64Array] = []
    for seed in seeds + axes:
        if all(abs(float(seed @ other)) < math.cos(math.radians(SAME_DEG)) for other in kept):
            kept.append(seed)
    return [sign * up for up in kept for sign in (1.0, -1.0)]


def _votes(flat: _Flat, directions: Float64Array) -> Float64Array:
    """Area that lies across each direction; of many directions, some are asked and the others get nothing."""
    votes = np.zeros(len(directions))
    for k in range(0, len(directions), max(1, len(directions) // 64)):
        votes[k] = flat.areas[np.abs(flat.normals @ directions[k]) > LYING_COS].sum()
    return votes


def _refine_normal(flat: _Flat, up: Float64Array) -> Float64Array:
    """The mean normal around a direction."""
    for _ in range(5):
        cos = flat.normals @ up
        near = np.abs(cos) > LYING_COS
        if not near.any():
            return up
        mean = (np.sign(cos[near]) * flat.areas[near]) @ flat.normals[near]
        up = mean / np.sqrt(mean @ mean)
    return up


def _candidate(flat: _Flat, up: Float64Array) -> UpCandidate:
    at = flat.all_means @ up
    low, high = np.quantile(at, [0.002, 0.998])
    size = max(float(high - low), 1e-9)
    lying = np.abs(flat.normals @ up) > LYING_COS
    level = np.clip((flat.means[lying] @ up - low) / size * LEVELS, -1, LEVELS + 1).astype(np.int64) + 1
    mass = np.convolve(np.bincount(level, flat.areas[lying], LEVELS + 3), np.ones(3), "same")
    peaks = _peaks(mass)
    heights = low + (np.array(peaks) - 0.5) * size / LEVELS
    floor = float(heights[0])
    span = float(high) - floor
    between = at[(at > floor + 0.03 * size) & (at < high - 0.03 * size)]
    standing = float((between < floor + 0.5 * span).mean()) if len(between) else 0.0
    roof = float(heights[-1]) - floor
    closed = len(peaks) > 1 and float((at > heights[-1] + 0.03 * size).mean()) < CLOSED_MAX
    return UpCandidate(
        name=up_name(up),
        up=up,
        floor=floor,
        support=float(mass[peaks[0]] / max(flat.areas.sum(), 1e-12)),
        above=float((at > floor - 0.02 * size).mean()),
        standing=standing,
        levels=tuple(float(height) for height in heights[1:]),
        ceiling=roof if closed else None,
    )


def _peaks(mass: Float64Array) -> list[int]:
    """Slices with the planes, lowest first."""
    peaks: list[int] = []
    for k in np.nonzero(mass >= PLANE_RATIO_MIN * mass.max())[0].tolist():
        if peaks and k - peaks[-1] <= LEVELS // 25:
            peaks[-1] = k if mass[k] > mass[peaks[-1]] else peaks[-1]
        else:
            peaks.append(k)
    return peaks


def up_name(up: Float64Array) -> str:
    """A direction as `--up` takes it."""
    for name, R in R_UP.items():
        if float(np.array(R[2]) @ up) > math.cos(math.radians(AXIS_DEG)):
            return name
    return ",".join(f"{value:.4f}" for value in up)


def _scales(up: UpCandidate, size: Float64Array, detail: float) -> tuple[ScaleCandidate, ...]:
    found = []
    if up.ceiling is not None:
        reason = f"its ceiling is {up.ceiling:.3g} units above its floor, as in a room of {ROOM_HEIGHT_M} m"
        found.append(ScaleCandidate(metres_per_unit=ROOM_HEIGHT_M / up.ceiling, reason=reason))
    for name, metres in UNITS_M.items():
        tall = up.ceiling is None or ROOM_HEIGHTS_M[0] <= up.ceiling * metres <= ROOM_HEIGHTS_M[1]
        if tall and SIZES_M[0] <= float(size.max()) * metres <= SIZES_M[1]:
            reason = f"if the file is in {name}, it is {float(size.max()) * metres:.3g} m wide"
            found.append(ScaleCandidate(metres_per_unit=metres, reason=reason))
    rough = f"roughly: its Gaussians would have the usual size of {100 * DETAIL_M:g} cm"
    found.append(ScaleCandidate(metres_per_unit=DETAIL_M / max(detail, 1e-9), reason=rough))
    return tuple(found)


def advice(found: Survey, up: str, scale: float) -> str:
    """What to try after an import with these options failed: options, and why."""
    options, reasons = [], []
    best = found.clear_up
    if best is None and up == "auto" and found.ups:
        options.append(f"--up={found.ups[0].name}")
        reasons.append(_standing_of_best(found))
    elif (
        best is not None
        and up not in ("auto", UP_OF_CAMERAS)
        and float(R_from_up(up)[2] @ best.up) < math.cos(math.radians(SAME_DEG))
    ):
        options.append(f"--up={best.name}")
        reasons.append(f"{100 * best.above:.0f} % of the scene is above the plane that it makes the floor")
    likely = found.scales[0]
    if abs(math.log(likely.metres_per_unit / scale)) > math.log(SCALE_RATIO):
        options.append(f"--scale {likely.metres_per_unit:.3g}")
        reasons.append(likely.reason)
    if not options:
        is_small = float((found.high - found.low).max()) * scale < SIZES_M[0]
        words = "No other axes or scale suggest themselves" + (": is it an object? " if is_small else "; ")
        return words + ("If it is a place to walk in, " if is_small else "") + "--crop away what surrounds it."
    return f"Try {' '.join(options)} ({'; '.join(reasons)})."


def _standing_of_best(found: Survey) -> str:
    """What speaks for the best candidate for up, which is not clear."""
    best, *others = found.ups
    words = f"the best candidate: {100 * best.above:.0f} % of the scene is above its floor"
    if others:
        words += f"; --up={others[0].name} has {100 * others[0].score / best.score:.0f} % of its score"
    return words


def survey_row(found: Survey) -> dict[str, Any]:
    """A survey as plain values."""
    return {
        "gaussians": found.gaussians,
        "extent_low": found.low.tolist(),
        "extent_high": found.high.tolist(),
        "up_candidates": [
            {"up": up.name, "score": up.score, "floor": up.floor, "support": up.support, "ceiling": up.ceiling}
            for up in found.ups
        ],
        "scale_candidates": [asdict(scale) for scale in found.scales],
    }
