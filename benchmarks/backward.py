"""Training views per second (forward and backward) of the differentiable rasterizer on one core.

    python benchmarks/backward.py --json

The scene is a synthetic furnished room of flat Gaussians of 1 to 4 cm with SH of degree 3, sorted by `spatial_order`;
cameras stand in its free middle. A view is `rasterize`, and the gradients of all parameters for a given gradient of its
colours, once with sparse and once with dense gradients. Nothing is kept from one view to the next but memory, as all
parameters change in a training. Times are CPU times of this thread; per view the fastest of several runs counts, and
the mean over views is given, next to the slowest. The peer is the torch reference on a scene that it can hold.
"""

import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
import torch
import tyro

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common.rasterizer.differentiable import frame
from common.rasterizer.differentiable.autograd import Rendered, rasterize
from common.rasterizer.differentiable.order import spatial_order
from common.rasterizer.differentiable.reference import rasterize_with_torch

Floats = npt.NDArray[np.float64]
Parameters = dict[str, torch.Tensor]

STAGES = {
    "cull": ("bound_chunks",),
    "project": ("project", "list_drawn"),
    "sort": ("begin_slab", "sort_keys"),
    "bin": ("fill_tiles",),
    "blend": ("begin_planes", "gather_features", "blend"),
    "blend_gradients": ("begin_replay", "blend_gradients"),
    "project_gradients": ("project_gradients",),
}
ROOM_M = np.array([8.0, 6.0, 2.8])
PIECES = 14
"""Boxes that stand along the walls."""
FOV_RAD = math.radians(100.0)


def main(
    *,
    gaussians: int = 500_000,
    sizes_px: tuple[tuple[int, int], ...] = ((144, 256), (270, 480)),
    feature_counts: tuple[int, ...] = (0, 4),
    views: int = 6,
    runs: int = 5,
    peer_gaussians: int = 2000,
    seed: int = 0,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure.

    Args:
        gaussians: Gaussians of the room.
        sizes_px: Image heights and widths.
        feature_counts: Feature channels besides colour, depth and alpha.
        views: Camera poses.
        runs: Runs per view, of which the fastest counts.
        peer_gaussians: Gaussians of the smaller scene for the torch reference; 0 leaves it out.
        seed: Seed of scene and poses.
        json_output: Print JSON.
    """
    torch.set_num_threads(1)
    rng = np.random.default_rng(seed)
    scene = parameters(room(gaussians, rng), rng, 0)
    poses = [camera_pose(rng) for _ in range(views)]
    cases = [
        _measure(with_features(scene, features, rng), poses, size, runs, sparse)
        for size in sizes_px
        for features in feature_counts
        for sparse in (True, False)
        if sparse or features == feature_counts[0]
    ]
    result: dict[str, Any] = {"gaussians": gaussians, "sh_degree": 3, "cases": cases}
    if peer_gaussians:
        result["peer"] = _peer(parameters(room(peer_gaussians, rng), rng, 0), poses[0])
    print(json.dumps(result) if json_output else _table(result))


def room(count: int, rng: np.random.Generator) -> dict[str, Floats]:
    """Means, quaternions, scales and opacities of flat Gaussians on the surfaces of a furnished room."""
    boxes = [np.stack([np.zeros(3), ROOM_M]), *(_piece(rng) for _ in range(PIECES))]
    faces = [(box, axis, side) for box in boxes for axis in range(3) for side in range(2)]
    area = np.array([np.prod(np.delete(box[1] - box[0], axis)) for box, axis, _ in faces])
    face = np.sort(rng.choice(len(faces), size=count, p=area / area.sum()))
    means = rng.uniform(size=(count, 3))
    quats = np.zeros((count, 4))
    # The third axis, which is thin, is turned into the direction of the surface's normal.
    turns = ((1.0, 0.0, 1.0, 0.0), (1.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    for number, (box, axis, side) in enumerate(faces):
        here = face == number
        means[here] = box[0] + means[here] * (box[1] - box[0])
        means[here, axis] = box[side, axis]
        quats[here] = turns[axis]
    scales = rng.uniform(0.01, 0.04, size=(count, 3))
    scales[:, 2] = 0.002
    return {
        "means_m": means + rng.normal(scale=0.003, size=(count, 3)),
        "quats_wxyz": quats + rng.normal(scale=0.05, size=(count, 4)),
        "scales_m": scales,
        "opacities": 1 / (1 + np.exp(-rng.normal(0.5, 2.0, size=count))),
    }


def _piece(rng: np.random.Generator) -> Floats:
    """A box at a wall: its lowest and highest corner."""
    size = rng.uniform((0.5, 0.5, 0.4), (1.6, 0.9, 2.0))
    low = rng.uniform((0.0, 0.0, 0.0), ROOM_M - size)
    axis = int(rng.integers(0, 2))
    low[axis] = rng.choice((0.0, ROOM_M[axis] - size[axis]))
    low[2] = 0.0
    return np.stack([low, low + size])


def parameters(arrays: dict[str, Floats], rng: np.random.Generator, features: int) -> Parameters:
    """Tensors that require gradients, in spatial order."""
    order = spatial_order(arrays["means_m"].astype(np.float32))
    sh = 0.1 * rng.normal(size=(len(order), 16, 3))
    sh[:, 0] = rng.uniform(-1.6, 1.6, size=(len(order), 3))
    values = {**{name: array[order] for name, array in arrays.items()}, "sh": sh}
    return {name: torch.tensor(array, dtype=torch.float32, requires_grad=True) for name, array in values.items()}


def with_features(scene: Parameters, count: int, rng: np.random.Generator) -> Parameters:
    """The scene with feature channels."""
    if not count:
        return scene
    features = torch.tensor(rng.normal(size=(len(scene["means_m"]), count)), dtype=torch.float32, requires_grad=True)
    return {**scene, "features": features}


def camera_pose(rng: np.random.Generator) -> torch.Tensor:
    """A level camera in the middle of the room that looks anywhere."""
    yaw = rng.uniform(-math.pi, math.pi)
    c, s = math.cos(yaw), math.sin(yaw)
    T = np.eye(4)
    T[:3, :3] = [[s, 0.0, c], [-c, 0.0, s], [0.0, -1.0, 0.0]]
    T[:3, 3] = rng.uniform((2.0, 2.0, 0.5), (6.0, 4.0, 1.5))
    return torch.tensor(T, requires_grad=True)


def _intrinsics(size_px: tuple[int, int]) -> Floats:
    height, width = size_px
    focal = 0.5 * width / math.tan(0.5 * FOV_RAD)
    return np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])


def _view(
    draw: Callable[..., Any], scene: Parameters, pose: torch.Tensor, size_px: tuple[int, int], **options: bool
) -> Any:
    """Forward, and backward from gradients of colours and features."""
    for tensor in (*scene.values(), pose):
        tensor.grad = None
    rendered = draw(
        **scene, T_world_camera=pose, K_px=_intrinsics(size_px), height_px=size_px[0], width_px=size_px[1], **options
    )
    images = [rendered.rgb] if rendered.features is None else [rendered.rgb, rendered.features]
    torch.autograd.backward(images, [torch.ones_like(image) for image in images])
    return rendered


def _measure(
    scene: Parameters, poses: list[torch.Tensor], size_px: tuple[int, int], runs: int, sparse: bool
) -> dict[str, Any]:
    def once(pose: torch.Tensor) -> Rendered:
        rendered: Rendered = _view(rasterize, scene, pose, size_px, sparse_gradients=sparse)
        return rendered

    for pose in poses[:2]:
        once(pose)
    view_s, visible, hidden = [], [], []
    for pose in poses:
        spent_s = []
        for _ in range(runs):
            begin_s = time.thread_time()
            rendered = once(pose)
            spent_s.append(time.thread_time() - begin_s)
        view_s.append(min(spent_s))
        visible.append(len(rendered.visibility.index))
        hidden.append(int((rendered.visibility.weight == 0).sum()))
    with _clocks() as stages_s:
        begin_s = time.thread_time()
        for pose in poses:
            once(pose)
        total_s = time.thread_time() - begin_s
    stages_ms = {name: 1e3 * seconds / len(poses) for name, seconds in stages_s.items()}
    return {
        "size_px": list(size_px),
        "features": scene["features"].shape[1] if "features" in scene else 0,
        "gradients": "sparse" if sparse else "dense",
        "views_per_s": 1 / float(np.mean(view_s)),
        "slowest_view_per_s": 1 / max(view_s),
        "drawn_gaussians": float(np.mean(visible)),
        "of_them_without_weight": float(np.mean(hidden)),
        "stages_ms": {**stages_ms, "everything_else": 1e3 * total_s / len(poses) - sum(stages_ms.values())},
    }


def _peer(scene: Parameters, pose: torch.Tensor) -> dict[str, Any]:
    """The torch reference in both precisions on the same small view."""
    size_px = (72, 128)
    seconds = {}
    for name, dtype in (("torch_float32", torch.float32), ("torch_float64", torch.float64)):
        copies = {key: value.detach().to(dtype).requires_grad_() for key, value in scene.items()}
        seconds[name] = _fastest(lambda copies=copies: _view(rasterize_with_torch, copies, pose, size_px), 2)
    seconds["rasterize"] = _fastest(lambda: _view(rasterize, scene, pose, size_px), 20)
    return {
        "size_px": list(size_px),
        "gaussians": len(scene["means_m"]),
        **{f"{name}_views_per_s": 1 / spent_s for name, spent_s in seconds.items()},
        "times_faster_than_torch_float32": seconds["torch_float32"] / seconds["rasterize"],
    }


def _fastest(call: Callable[[], Any], runs: int) -> float:
    spent_s = []
    for _ in range(runs):
        begin_s = time.thread_time()
        call()
        spent_s.append(time.thread_time() - begin_s)
    return min(spent_s)


@contextmanager
def _clocks() -> Iterator[dict[str, float]]:
    """Time the kernels of each stage while the block runs."""
    spent_s = dict.fromkeys(STAGES, 0.0)
    originals = {name: getattr(frame, name) for names in STAGES.values() for name in names}

    def clocked(stage: str, kernel: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any) -> Any:
            begin_s = time.thread_time()
            result = kernel(*args)
            spent_s[stage] += time.thread_time() - begin_s
            return result

        return call

    for stage, names in STAGES.items():
        for name in names:
            setattr(frame, name, clocked(stage, originals[name]))
    try:
        yield spent_s
    finally:
        for name, kernel in originals.items():
            setattr(frame, name, kernel)


def _table(result: dict[str, Any]) -> str:
    lines = [f"{result['gaussians']} Gaussians, SH degree {result['sh_degree']}"]
    for case in result["cases"]:
        stages = ", ".join(f"{name} {ms:.2f}" for name, ms in case["stages_ms"].items())
        lines.append(
            f"{case['size_px']} {case['features']} features, {case['gradients']} gradients: "
            f"{case['views_per_s']:.1f}/s, slowest view {case['slowest_view_per_s']:.1f}/s, "
            f"{case['drawn_gaussians']:.0f} drawn, {case['of_them_without_weight']:.0f} of them hidden\n  ms: {stages}"
        )
    lines += [f"{name} {value}" for name, value in result.get("peer", {}).items()]
    return "\n".join(lines)


if __name__ == "__main__":
    tyro.cli(main)
