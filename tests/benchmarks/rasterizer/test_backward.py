import numpy as np
import pytest

pytest.importorskip("torch", reason="torch is not installed")

from readygo.benchmarks.rasterizer import backward
from readygo.services.reconstructor.differentiable import frame


def test_scene_keeps_its_parameters_and_gets_features_on_request() -> None:
    scene = backward.parameters(2000, 0)
    assert {len(tensor) for tensor in scene.values()} == {2000}
    assert all(tensor.requires_grad for tensor in scene.values())
    rich = backward.with_features(scene, 4, np.random.default_rng(0))
    assert rich["features"].shape == (2000, 4)
    assert rich["features"].requires_grad
    assert backward.with_features(scene, 0, np.random.default_rng(0)) is scene


def test_clocks_give_the_kernels_back() -> None:
    names = [name for names in backward.STAGES.values() for name in names]
    before = [getattr(frame, name) for name in names]
    with backward._clocks() as spent_s:
        clocked = [getattr(frame, name) for name in names]
    assert all(one is not other for one, other in zip(clocked, before, strict=True))
    assert spent_s == dict.fromkeys(backward.STAGES, 0.0)
    assert [getattr(frame, name) for name in names] == before


def test_table_has_a_line_per_case_and_the_peer() -> None:
    case = {
        "size_px": [144, 256], "features": 4, "gradients": "sparse", "views_per_s": 12.34, "slowest_view_per_s": 5.0,
        "drawn_gaussians": 100.0, "of_them_without_weight": 7.0, "stages_ms": {"cull": 1.234},
    }  # fmt: skip
    text = backward._table({"gaussians": 9, "sh_degree": 3, "cases": [case], "peer": {"torch_views_per_s": 2.0}})
    lines = text.splitlines()
    assert lines[0] == "9 Gaussians, SH degree 3"
    assert lines[1].startswith("[144, 256] 4 features, sparse gradients: 12.3/s, slowest view 5.0/s, 100 drawn, 7 of")
    assert lines[2:] == ["  ms: cull 1.23", "torch_views_per_s 2.0"]
