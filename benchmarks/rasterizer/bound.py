"""The time that an image takes if nothing but its necessary multiplications and additions cost any.

Operations are counted per Gaussian, or per Gaussian and 4x4 block of pixels, of those that add to a pixel before it is
finished: a renderer that knew them beforehand would do no others. A fused multiply-add is one operation, as is a lone
multiplication or addition, since they share a pipe; sixteen go at once. Divisions, roots, comparisons, conversions,
loads and the whole of culling, sorting and binning count nothing.
"""

import time
from typing import Any

import numpy as np

from readygo.benchmarks.rasterizer.footprints import Work, count_work, footprints
from readygo.benchmarks.rasterizer.setting import Setting
from readygo.common.kernels import kernel
from readygo.common.simd.memory import store_f16
from readygo.common.simd.types import f16, fma

LANES = 16
PROJECT_OPS = 9 + 4 + 14 + 18 + 9 + 6 + 6
"""Camera coordinates; position in the image; rows of the Jacobian; their products with the covariance; image
covariance; its inverse; box."""
COLOUR_OPS = {1: 0, 4: 33, 9: 58, 16: 95}
"""By SH coefficients: unit direction in the world (15), basis (0, 3, 13, 29), sums (3 per coefficient), offset (3)."""
SKIN_OPS = 12
"""Per joint that moves a Gaussian: one multiply-add per entry of a 3x4 matrix. Finding the nearest rotation counts
nothing."""
BLEND_OPS = 14
"""Per block of 16 pixels: exponent as a polynomial of the pixel (5), power of two (4), weight, three colours,
transmittance."""
BOUND_VIEWS = 4
"""Views whose work is counted."""
PEAK_STEPS = 200_000


@kernel
def _four_chains(steps: int, out: Any) -> None:
    x = f16(0.999)
    a, b, c, d = f16(0.1), f16(0.2), f16(0.3), f16(0.4)
    for _ in range(steps):
        a, b, c, d = fma(a, x, x), fma(b, x, x), fma(c, x, x), fma(d, x, x)
    store_f16(out, 0, a + b + c + d)


@kernel
def _ten_chains(steps: int, out: Any) -> None:
    x = f16(0.999)
    a, b, c, d, e = f16(0.1), f16(0.2), f16(0.3), f16(0.4), f16(0.5)
    p, q, r, s, t = f16(0.6), f16(0.7), f16(0.8), f16(0.9), f16(1.1)
    for _ in range(steps):
        a, b, c, d, e = fma(a, x, x), fma(b, x, x), fma(c, x, x), fma(d, x, x), fma(e, x, x)
        p, q, r, s, t = fma(p, x, x), fma(q, x, x), fma(r, x, x), fma(s, x, x), fma(t, x, x)
    store_f16(out, 0, a + b + c + d + e + p + q + r + s + t)


def peak_fma_per_s() -> float:
    """Sixteen-lane multiply-adds per second of this core, the best of several runs.

    Ten independent chains hide the latency of AVX-512 units, four that of AVX2 units, which have fewer registers.
    """
    out = np.zeros(16, dtype=np.float32)
    best = 0.0
    for chains, loop in ((4, _four_chains), (10, _ten_chains)):
        loop(1, out)
        for _ in range(8):
            begin_s = time.thread_time()
            loop(PEAK_STEPS, out)
            best = max(best, chains * PEAK_STEPS / (time.thread_time() - begin_s))
    return best


def mean_work(setting: Setting) -> dict[str, float]:
    """The work of an image, the mean over the first views."""
    scene, camera = setting.scenery.cloud(), setting.camera
    works: list[Work] = []
    for place in setting.places[:BOUND_VIEWS]:
        view = setting.view(place, 0)
        cloud = setting.cloud(scene, view.humans)
        prints = footprints(cloud, view.T_world_camera, camera.K_px, camera.height_px, camera.width_px)
        works.append(count_work(prints, len(scene), camera.height_px, camera.width_px))
    return {name: float(np.mean([getattr(work, name) for work in works])) for name in Work.__dataclass_fields__}


def bound_ms(work: dict[str, float], setting: Setting, scene_coefficients: int, fma_per_s: float) -> dict[str, float]:
    """Least time per image of each stage that has necessary operations [ms].

    Args:
        work: Mean counts per image, from `mean_work`.
        setting: Whose avatars tell how many joints move a Gaussian.
        scene_coefficients: SH coefficients per channel of the scene.
        fma_per_s: Peak rate of multiply-adds [1/s], from `peak_fma_per_s`.
    """
    humans = sum(len(avatar.cloud) for avatar in setting.avatars)
    joints = sum(int((avatar.lbs_weight > 0).sum()) for avatar in setting.avatars) / max(humans, 1)
    human_coefficients = max((avatar.cloud.sh.shape[1] for avatar in setting.avatars), default=1)
    scene_ops = PROJECT_OPS + COLOUR_OPS[scene_coefficients]
    human_ops = PROJECT_OPS + COLOUR_OPS[human_coefficients] + SKIN_OPS * joints
    operations = {
        "project_scene": (work["drawn"] - work["drawn_people"]) * scene_ops / LANES,
        "pose_and_project_people": work["drawn_people"] * human_ops / LANES,
        "blend": work["block_entries"] * BLEND_OPS,
    }
    return {stage: 1e3 * count / fma_per_s for stage, count in operations.items()}
