"""The engine for a GPU against that of the CPU; the CPU's rasterizer stands in for gsplat."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from readygo.common.errors import ReadygoError, RunError
from readygo.services.reconstructor.training import cuda, train
from readygo.services.reconstructor.training.config import GaussiansConfig, GeometryConfig
from readygo.services.reconstructor.training.cpu import CpuEngine
from readygo.services.reconstructor.training.cuda import CudaEngine, cuda_engine
from readygo.services.reconstructor.training.density import Sightings, changed_density
from readygo.services.reconstructor.training.engine import Engine, ViewTask
from readygo.services.reconstructor.training.parameters import Gaussians
from readygo.services.reconstructor.training.photos import PhotoStore, open_posed
from readygo.services.reconstructor.training.progress import TrainingProgress
from readygo.services.reconstructor.training.schedule import TrainingSchedule
from readygo.services.reconstructor.training.train import train_gaussians
from tests.common.rasterizer.gpu.differentiable_rasterization import DifferentiableRasterization
from tests.services.reconstructor.training.conftest import SIZE_PX, VIEWS, true_gaussians

Write = Callable[[Path], Path]
PLAIN = GaussiansConfig(steps=40, sh_degree=0)
SUMS = replace(PLAIN, density=replace(PLAIN.density, weak_texture=True))
MCMC = replace(PLAIN, density=replace(PLAIN.density, method="mcmc"))
SURFACES = replace(PLAIN, geometry=GeometryConfig(enabled=True, noise_px=3.0, flatten=10.0))
KINDS = pytest.mark.parametrize("settings", [PLAIN, SUMS, MCMC, SURFACES], ids=["plain", "sums", "mcmc", "surfaces"])


@pytest.fixture
def photos(write_posed: Write, tmp_path: Path) -> PhotoStore:
    """All views of the small scene."""
    posed = open_posed(write_posed(tmp_path / "posed"), tmp_path / "undistorted")
    return PhotoStore(posed, tuple(range(VIEWS)), 1000, 1)


def in_cuda(settings: GaussiansConfig) -> CudaEngine:
    return CudaEngine(settings, torch.device("cpu"), DifferentiableRasterization())


def disturbed() -> Gaussians:
    gaussians, rng = true_gaussians(), np.random.default_rng(5)
    for name, size in (("means_m", 0.03), ("quats_wxyz", 0.3), ("log_scales", 0.3), ("logits", 0.5), ("sh", 0.2)):
        value = gaussians.values[name]
        value += rng.normal(0, size, value.shape).astype(np.float32)
    gaussians.values["means_m"][7] = [0.0, 0.0, -2.0]
    return gaussians


def loaded(engine: Engine) -> Engine:
    gaussians = disturbed()
    engine.load(gaussians, Sightings.none(len(gaussians)))
    return engine


def tasks(settings: GaussiansConfig, step: int = 0) -> list[ViewTask]:
    exposure = np.array([[0.1, -0.1, 0.0], [0.02, 0.0, -0.02]], dtype=np.float32)
    rngs = [np.random.default_rng((step, slot)) if settings.geometry.enabled else None for slot in range(2)]
    return [
        ViewTask(number=2, exposure=exposure, rng=rngs[0], neighbour=3),
        ViewTask(number=4, exposure=0 * exposure, rng=rngs[1], neighbour=None),
    ]


@KINDS
def test_steps_are_those_of_the_cpu(photos: PhotoStore, settings: GaussiansConfig) -> None:
    engines, schedule = [loaded(CpuEngine(settings)), loaded(in_cuda(settings))], TrainingSchedule(settings, 1.0)
    for step in range(3):
        one, other = (engine.views(photos, tasks(settings, step), 0) for engine in engines)
        for a, b in zip(one, other, strict=True):
            assert b.loss == pytest.approx(a.loss, rel=1e-4)
            np.testing.assert_allclose(b.exposure, a.exposure, atol=2e-4 * float(np.abs(a.exposure).max()))
        for engine in engines:
            engine.change(schedule.rates(step))
    (wanted, wanted_seen), (found, found_seen) = (engine.arrays() for engine in engines)
    np.testing.assert_array_equal(found.updates, wanted.updates)
    assert found.updates[7] == 0
    assert found.updates.max() == 3
    np.testing.assert_array_equal(found_seen.views, wanted_seen.views)
    np.testing.assert_allclose(found_seen.gradient, wanted_seen.gradient, rtol=2e-3, atol=1e-5)
    for name, value in wanted.values.items():
        moved = np.abs(value - disturbed().values[name]).max()
        assert moved > 0.0, name
        np.testing.assert_allclose(found.first[name], wanted.first[name], atol=2e-3 * np.abs(wanted.first[name]).max())
        assert np.mean(np.abs(found.values[name] - value) > 0.02 * moved) < 0.01, name


def test_masks_and_depths_are_those_of_the_cpu(write_posed: Write, tmp_path: Path) -> None:
    folder, mask = write_posed(tmp_path / "posed"), np.full(SIZE_PX, 255, np.uint8)
    mask[5:25, 10:30] = 0
    for kind, image in {"masks": mask, "depth": np.full(SIZE_PX, 2100, np.uint16)}.items():
        (folder / kind).mkdir()
        for number in range(VIEWS):
            cv2.imwrite(str(folder / kind / f"{number}.png.png"), image)
    photos = PhotoStore(open_posed(folder, tmp_path / "undistorted"), tuple(range(VIEWS)), 1000, 1)
    engines = [loaded(CpuEngine(SURFACES)), loaded(in_cuda(SURFACES))]
    one = engines[0].views(photos, tasks(SURFACES), 0)
    other = engines[1].views(photos, tasks(SURFACES), 0)
    for a, b in zip(one, other, strict=True):
        assert b.loss == pytest.approx(a.loss, rel=1e-4)
        np.testing.assert_allclose(b.exposure, a.exposure, atol=2e-4 * float(np.abs(a.exposure).max()))
    for engine in engines:
        engine.change(TrainingSchedule(SURFACES, 1.0).rates(0))
    (wanted, _), (found, _) = (engine.arrays() for engine in engines)
    for name, first in wanted.first.items():
        np.testing.assert_allclose(found.first[name], first, atol=2e-3 * np.abs(first).max())


def test_views_that_show_a_gaussian_are_those_of_the_cpu(photos: PhotoStore) -> None:
    one, other = loaded(CpuEngine(PLAIN)), loaded(in_cuda(PLAIN))
    groups = [[0, 1], *([number] for number in range(2, VIEWS))]
    wanted = one.seen_by(photos, groups, 0.1)
    np.testing.assert_array_equal(other.seen_by(photos, groups, 0.1), wanted)
    assert wanted[7] == 0
    assert wanted.max() == VIEWS - 1


def test_noise_moves_faint_gaussians_as_far_as_the_cpu_does() -> None:
    engines = [CpuEngine(MCMC), in_cuda(MCMC)]
    spread = []
    for engine in engines:
        gaussians = true_gaussians()
        gaussians.values["log_scales"] += np.array([0.0, -1.0, -3.0], dtype=np.float32)
        gaussians.values["logits"][:75] = -9.0
        before = gaussians.values["means_m"].copy()
        engine.load(gaussians, Sightings.none(len(gaussians)))
        engine.add_noise(50.0, np.random.default_rng(0))
        away = engine.arrays()[0].values["means_m"] - before
        assert not np.abs(away[75:]).max() > 1e-6
        spread.append(away[:75].std(axis=0))
    np.testing.assert_allclose(spread[1], spread[0], rtol=0.3)


def test_stretched_gaussians_are_shortened(photos: PhotoStore) -> None:
    gaussians, engine = disturbed(), in_cuda(PLAIN)
    gaussians.values["log_scales"][3] = [-9.0, 0.0, -6.0]
    engine.load(gaussians, Sightings.none(len(gaussians)))
    engine.views(photos, tasks(PLAIN), 0)
    engine.change(TrainingSchedule(PLAIN, 1.0).rates(0))
    scales = np.sort(engine.arrays()[0].scales_m, axis=1)
    assert (scales[:, 2] <= 20.001 * scales[:, 1]).all()


def test_arrays_come_back_as_they_were_loaded() -> None:
    gaussians, seen = disturbed(), Sightings.none(150)
    gaussians.first["sh"] += 1.0
    gaussians.updates[:5] = 4.0
    seen.views[:] = 2.0
    engine = in_cuda(PLAIN)
    engine.load(gaussians, seen)
    back, back_seen = engine.arrays()
    for name, array in gaussians.state().items():
        np.testing.assert_array_equal(back.state()[name], array)
    np.testing.assert_array_equal(back_seen.views, seen.views)
    back.values["means_m"][:] = 0.0
    assert engine.arrays()[0].values["means_m"].any()


@pytest.mark.parametrize("settings", [MCMC, PLAIN], ids=["mcmc", "gradients"])
def test_gaussians_are_added_and_removed_as_on_the_cpu(settings: GaussiansConfig) -> None:
    rebuilt = []
    for engine in (CpuEngine(settings), in_cuda(settings)):
        gaussians = disturbed()
        gaussians.values["logits"][:20] = -9.0
        gaussians.updates[:] = np.arange(150)
        gaussians.first["sh"] += gaussians.updates[:, None]
        seen = Sightings.none(len(gaussians))
        seen.add(np.arange(40, 70), np.ones(30, dtype=np.float32))
        engine.load(gaussians, seen)
        engine.rebuild(changed_density(*engine.shapes(), settings.density, 5.0, np.random.default_rng(0)))
        rebuilt.append(engine.arrays())
    (one, one_seen), (other, other_seen) = rebuilt
    for name, array in one.state().items():
        np.testing.assert_array_equal(other.state()[name], array)
    assert 0 < (one.updates == 0).sum() < len(one)
    assert not other_seen.views.any()
    assert len(other_seen.gradient) == len(one_seen.gradient) == len(one)


def test_numbers_that_are_not_finite_are_named() -> None:
    for engine in (CpuEngine(PLAIN), in_cuda(PLAIN)):
        gaussians = disturbed()
        engine.load(gaussians, Sightings.none(len(gaussians)))
        assert engine.not_finite() is None
        gaussians.values["log_scales"][3, 1] = np.inf
        engine.load(gaussians, Sightings.none(len(gaussians)))
        assert engine.not_finite() == "log_scales"


@pytest.mark.usefixtures("few_steps")
@pytest.mark.parametrize("settings", [MCMC, SURFACES], ids=["mcmc", "surfaces"])
def test_whole_training_goes_on_where_it_was_interrupted_and_scores_like_the_cpu(
    write_posed: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: GaussiansConfig
) -> None:
    posed = write_posed(tmp_path / "posed")
    geometry = replace(settings.geometry, flatten=1.0)
    density = replace(settings.density, count_max=200)
    small = replace(settings, hold_out=5, density=density, geometry=geometry)
    on_cpu = train_gaussians(posed, tmp_path / "cpu", small, lambda _: None)
    monkeypatch.setattr(cuda, "cuda_engine", in_cuda)
    monkeypatch.setattr(train, "_TELL_EVERY_S", 0.0)
    heard: list[int] = []

    def interrupt(at: TrainingProgress) -> None:
        heard.append(at.step)
        if at.step == 23:
            raise KeyboardInterrupt

    with_cuda = replace(small, device="cuda")
    monkeypatch.setattr(train, "_SAVE_EVERY_S", 0.0)
    with pytest.raises(KeyboardInterrupt):
        train_gaussians(posed, tmp_path / "cuda", with_cuda, interrupt)
    found = train_gaussians(posed, tmp_path / "cuda", with_cuda, lambda at: heard.append(at.step))
    assert heard == list(range(1, 41))
    assert found["psnr_db"] == pytest.approx(on_cpu["psnr_db"], abs=0.7)
    assert found["settings"]["device"] == "cuda"


def test_gpu_without_room_is_one_line(write_posed: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full(CudaEngine):
        def views(self, *_: object) -> list:
            raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.")

    monkeypatch.setattr(
        cuda, "cuda_engine", lambda settings: Full(settings, torch.device("cpu"), DifferentiableRasterization())
    )
    with pytest.raises(RunError, match=r"The GPU's memory ran out with at most 150,000 Gaussians.*density.count_max"):
        train_gaussians(
            write_posed(tmp_path / "posed"), tmp_path / "out", replace(PLAIN, device="cuda"), lambda _: None
        )


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_without_a_gpu_it_is_refused_in_one_line() -> None:
    with pytest.raises(ReadygoError, match="gsplat"):
        cuda_engine(PLAIN)
