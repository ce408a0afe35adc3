"""Whether a map of cameras can be trusted, in numbers and in words."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.similarity import umeyama

REGISTERED_MIN = 0.6
"""A map that has fewer of the images, as share, is refused."""
_REPROJECTION_MAX_PX = 2.0
_POINTS_MIN = 30
"""An image that sees fewer points hangs by a thread."""
_SECOND_MAX = 0.2
"""A second piece with more of the images, as share, is a part of the place that is lost."""
_LOOP_POINTS = 20
DOUBTFUL_POINTS = 200
"""A map whose images see fewer points in the median is made again, to see whether the same comes of it."""
_SAME_SHARE, _SAME_PLACE, _SAME_FOCAL = 0.8, 0.05, 0.1
"""Two maps of the same matches must have this share of the images in common, put their cameras at the same places, but
for this share of the way across all, and find the same focal length, but for this share."""
ADVICE = (
    "Film again: walk slowly and sideways to what you look at, keep two thirds of the picture from one image to the "
    "next, come back to where you began, with light and without blur."
)


@dataclass(frozen=True, kw_only=True)
class PoseVerdict:
    """What speaks for and against a map. A low reprojection error alone proves nothing."""

    images: int
    registered: int
    components: tuple[int, ...]
    """Images of each piece that the mapper made, the largest first; those in a piece before it do not count."""
    points: int
    reprojection_px: float
    """Mean over points, weighted by their views [px]."""
    points_per_image: float
    """Median number of points that an image sees."""
    weakest_link: int
    """Fewest points that images before and after one place of the sequence share: where a map bends."""
    loops: int
    """Pairs of images at least a third of the sequence apart that share points: they hold drift down."""
    sequential: bool

    @property
    def registered_share(self) -> float:
        """Share of the images that have a pose."""
        return self.registered / max(self.images, 1)

    @property
    def drift(self) -> str:
        """What is known of drift, in words."""
        if not self.sequential:
            return "images in no order"
        if self.loops:
            return f"held by {self.loops} pairs of images that meet again; weakest link {self.weakest_link} points"
        return f"not held: the way never meets itself; weakest link {self.weakest_link} points"


def judge(images: PosedImages, *, asked: int, components: tuple[int, ...], sequential: bool) -> PoseVerdict:
    """Measure a map.

    Args:
        images: The largest piece.
        asked: How many images there were.
        components: Images of each piece, the largest first.
        sequential: Whether the order of the images is that of a way.
    """
    view, point = images.seen.T
    views_of_point = np.bincount(point, minlength=len(images.points))
    per_image = np.bincount(view, minlength=len(images.names))
    weakest, loops = _links(images, views_of_point)
    weights = np.maximum(views_of_point, 1)
    error_px = float((images.errors_px * weights).sum() / weights.sum()) if len(images.points) else float("inf")
    return PoseVerdict(
        images=asked,
        registered=len(images.names),
        components=components,
        points=len(images.points),
        reprojection_px=error_px,
        points_per_image=float(np.median(per_image)) if len(per_image) else 0.0,
        weakest_link=weakest,
        loops=loops,
        sequential=sequential,
    )


def _links(images: PosedImages, views_of_point: Int64Array) -> tuple[int, int]:
    """Fewest points across a place of the sequence, and pairs of images far apart that share points."""
    count, total = len(images.names), len(views_of_point)
    view, point = images.seen.T
    first, last = np.full(total, count), np.full(total, -1)
    np.minimum.at(first, point, view)
    np.maximum.at(last, point, view)
    seen = last >= 0
    crossing = np.cumsum(np.bincount(first[seen], minlength=count) - np.bincount(last[seen], minlength=count))
    far = count // 3
    shared: dict[tuple[int, int], int] = {}
    long = np.flatnonzero(last - first >= max(far, 1))
    order = np.argsort(point, kind="stable")
    starts = np.searchsorted(point[order], long)
    for start, number in zip(starts, long, strict=True):
        views = np.sort(view[order[start : start + views_of_point[number]]])
        for a in views:
            for b in views[views >= a + max(far, 1)]:
                shared[int(a), int(b)] = shared.get((int(a), int(b)), 0) + 1
    return int(crossing[:-1].min(initial=total)), sum(n >= _LOOP_POINTS for n in shared.values())


def disagreement(first: PosedImages, second: PosedImages | None) -> str | None:
    """How two maps of the same matches contradict each other, in words; None if they agree.

    The mapper begins with another pair of images for another seed. What is seen well comes out the same; a map that
    hangs by chance matches, or was bent to fit them, does not, however small its reprojection error is.

    Args:
        first: The map.
        second: Made with another seed; None where nothing came of it.
    """
    names = [] if second is None else sorted(set(first.names) & set(second.names))
    larger = max(len(first.names), 0 if second is None else len(second.names))
    if second is None or len(names) < max(3.0, _SAME_SHARE * larger):
        return f"made twice, the map has {len(first.names)} images, then {0 if second is None else len(second.names)}"
    focal = float(second.focal_px[0] / first.focal_px[0])
    if abs(np.log(focal)) > np.log1p(_SAME_FOCAL):
        return f"made twice, the focal length is {first.focal_px[0]:.0f} px, then {second.focal_px[0]:.0f} px"
    a, b = _places(first, names), _places(second, names)
    off = np.linalg.norm(umeyama(b, a).apply(b) - a, axis=1) / np.linalg.norm(np.ptp(a, axis=0))
    if off.max() > _SAME_PLACE:
        return f"made twice, cameras are {100 * off.max():.0f} % of the whole way apart"
    return None


def _places(images: PosedImages, names: list[str]) -> Float64Array:
    index = {name: number for number, name in enumerate(images.names)}
    return images.T_world_camera[[index[name] for name in names], :3, 3]


def refusal(verdict: PoseVerdict) -> str | None:
    """Why a map must not be used, with advice; None if nothing speaks against it."""
    said = f"{verdict.registered} of {verdict.images} images found a pose"
    if verdict.registered < 3 or verdict.registered_share < REGISTERED_MIN:
        return f"{said}; {100 * REGISTERED_MIN:.0f} % are needed. The images share too little. {ADVICE}"
    if len(verdict.components) > 1 and verdict.components[1] > _SECOND_MAX * verdict.images:
        pieces = " + ".join(str(size) for size in verdict.components)
        return f"The map falls into pieces of {pieces} images that do not meet. {ADVICE}"
    if verdict.reprojection_px > _REPROJECTION_MAX_PX:
        return f"{said}, but points are off by {verdict.reprojection_px:.1f} px in the mean: the map is bent. {ADVICE}"
    if verdict.points_per_image < _POINTS_MIN:
        return f"{said}, but see {verdict.points_per_image:.0f} points each: there is too little texture. {ADVICE}"
    return None
