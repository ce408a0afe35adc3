"""Training views per second (forward and backward) of the differentiable rasterizer on one core.

    python -m readygo.benchmarks.rasterizer.backward --json

The scene is the flat of `synthetic_room.py` with SH of degree 3, sorted by `spatial_order`; the robot's camera stands
anywhere in its free area. A view is `rasterize`, and the gradients of all parameters for a given gradient of its
colours, once with sparse and once with dense gradients. Nothing is kept from one view to the next but memory, as all
parameters change in a training. Times are CPU times of this thread; per view the fastest of several runs counts, and
the mean over views is given, next to the slowest. The peer is the torch reference on a scene that it can hold.
"""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import numpy as np
import torch
import tyro

from readygo.benchmarks.rasterizer.scenery import random_places, synthetic_scenery
from readygo.benchmarks.rasterizer.synthetic_room import room_cloud
from readygo.common.robot import CameraConfig
from readygo.services.reconstructor.differentiable import frame
from readygo.services.reconstructor.differentiable.autograd import Rendered, rasterize
from readygo.services.reconstructor.differentiable.order import spatial_order
from readygo.services.reconstructor.differentiable.reference import rasterize_with_torch

Parameters = dict[str, torch.Tensor]

STAGES = {
    "cull": ("bound_chunks",),
    "project": ("project", "list_drawn"),
    "blend": ("begin_planes", "gather_features", "blend"),
    "blend_gradients": ("begin_replay", "blend_gradients"),
    "project_gradients": ("project_gradients",),
}
MAP_GAUSSIANS = 1000
"""The flat's map does not depend on the number of its Gaussians."""
PEER_PX = (72, 128)


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
    scene = parameters(gaussians, seed)
    cases = [
        _measure(with_features(scene, features, rng), camera_poses(size, views, seed), size, runs, sparse)
        for size in sizes_px
        for features in feature_counts
        for sparse in (True, False)
        if sparse or features == feature_counts[0]
    ]
    result: dict[str, Any] = {"gaussians": gaussians, "sh_degree": 3, "cases": cases}
    if peer_gaussians:
        result["peer"] = _peer(parameters(peer_gaussians, seed), camera_poses(PEER_PX, 1, seed)[0])
    print(json.dumps(result) if json_output else _table(result))


def parameters(count: int, seed: int) -> Parameters:
    """The synthetic flat as tensors that require gradients, in spatial order."""
    cloud = room_cloud(count, seed)
    order = spatial_order(cloud.means_m)
    names = ("means_m", "quats_wxyz", "scales_m", "opacities", "sh")
    return {name: torch.tensor(getattr(cloud, name)[order], requires_grad=True) for name in names}


def with_features(scene: Parameters, count: int, rng: np.random.Generator) -> Parameters:
    """The scene with feature channels."""
    if not count:
        return scene
    features = torch.tensor(rng.normal(size=(len(scene["means_m"]), count)), dtype=torch.float32, requires_grad=True)
    return {**scene, "features": features}


def camera_poses(size_px: tuple[int, int], views: int, seed: int) -> list[torch.Tensor]:
    """Poses of the robot's camera at random places of the flat's free area."""
    scenery = synthetic_scenery(MAP_GAUSSIANS, seed)
    camera = CameraConfig(height_px=size_px[0], width_px=size_px[1])
    places = random_places(scenery, 0, views, seed)
    return [torch.tensor(place.T_world_camera(camera, 0), requires_grad=True) for place in places]


def _view(
    draw: Callable[..., Any], scene: Parameters, pose: torch.Tensor, size_px: tuple[int, int], **options: bool
) -> Any:
    """Forward, and backward from gradients of colours and features."""
    for tensor in (*scene.values(), pose):
        tensor.grad = None
    camera = CameraConfig(height_px=size_px[0], width_px=size_px[1])
    rendered = draw(
        **scene, T_world_camera=pose, K_px=camera.K_px, height_px=size_px[0], width_px=size_px[1], **options
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
    size_px = PEER_PX
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
