from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.camera.captured import CapturedViews
from readygo.common.errors import ConfigError, SceneError
from readygo.common.gaussians import concatenate, save_ply
from readygo.services.reconstructor import reconstruct as module
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.metric.config import MetricConfig
from readygo.services.reconstructor.reconstruct import CLOUD_FILE, STAGES, Job, reconstruct_scene
from readygo.services.reconstructor.stages import Stages
from tests.common.scenes.small_room import small_room

CONFIG = ReconstructorConfig(metric=MetricConfig(scale=1.0))
VIEWS = CapturedViews(
    images=("a.jpg",), sizes_px=np.array([[64, 48]]), K_px=np.eye(3)[None], T_world_camera=np.eye(4)[None]
)

POSES = {"kind": "video", "verdict": {}, "scale": {"source": "marker 0"}, "up": "", "markers": [], "notes": []}


@pytest.fixture
def trained(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Poses and training that take no time; hears what is trained."""
    pytest.importorskip("torch", reason="torch is not installed")
    calls: list[str] = []

    @contextmanager
    def open_job(source: Path, folder: Path, *_: Any) -> Iterator[tuple[Stages, Path]]:
        folder.mkdir(parents=True, exist_ok=True)
        yield Stages(folder, lambda progress: None), source

    def train(folder: Path) -> dict[str, Any]:
        calls.append("train")
        save_ply(small_room(), folder / CLOUD_FILE)
        return {"seconds": {"views": 3.0}, "gaussians": 5}

    monkeypatch.setattr(module, "open_job", open_job)
    monkeypatch.setattr(module, "find_poses_in", lambda *_: dict(POSES))
    monkeypatch.setattr(module, "_training", lambda *_: train)
    monkeypatch.setattr(module.colmap, "pinhole_views", lambda _: VIEWS)
    return calls


def test_scene_is_made_once_and_where_it_is_wanted(tmp_path: Path, trained: list[str]) -> None:
    job = Job(source=Path("walk.mp4"), out=tmp_path / "lobby", work=tmp_path / "lobby.work", license="CC0")
    first = reconstruct_scene(job, CONFIG, lambda progress: None)
    again = reconstruct_scene(job, CONFIG, lambda progress: None)
    assert trained == ["train"]
    assert first["content_hash"] == again["content_hash"]
    scene = module.load_scene(job.out)
    assert (scene.name, scene.license, len(scene.views or ())) == ("lobby", "CC0", 1)
    assert scene.metadata["source"]["scale_origin"] == "marker 0"
    assert set(first["seconds"]) <= set(STAGES)
    assert scene.reconstruction is not None
    assert scene.reconstruction["training"] == {"gaussians": 5}


def test_far_shell_is_the_sky_of_the_scene_and_counted_apart(
    tmp_path: Path, trained: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    room = small_room()
    turns = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    far = room.select(np.arange(12))
    means = np.column_stack([40 * np.cos(turns), 40 * np.sin(turns), np.full(12, 15.0)]).astype(np.float32)
    sky = replace(far, means_m=means, scales_m=np.full((12, 3), 8.0, np.float32), opacities=np.ones(12, np.float32))
    monkeypatch.setattr(module, "read_gaussians", lambda _: concatenate([room, sky]))
    job = Job(source=Path("walk.mp4"), out=tmp_path / "lobby", work=tmp_path / "lobby.work")
    report = reconstruct_scene(job, CONFIG, lambda progress: None)
    scene = module.load_scene(job.out)
    assert report["sky"] == 12
    assert scene.sky is not None
    assert len(scene.sky) == 12
    assert len(scene.cloud) == len(room)


def test_what_is_there_already_is_not_touched(tmp_path: Path, trained: list[str]) -> None:
    (tmp_path / "lobby").mkdir()
    job = Job(source=Path("walk.mp4"), out=tmp_path / "lobby", work=tmp_path / "lobby.work")
    with pytest.raises(SceneError, match="exists already"):
        reconstruct_scene(job, CONFIG, lambda progress: None)
    assert not trained
    assert not list(job.out.iterdir())


def test_missing_package_is_told_before_anything_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.importlib.util, "find_spec", lambda name: None if name == "pycolmap" else name)
    job = Job(source=tmp_path / "walk.mp4", out=tmp_path / "lobby", work=tmp_path / "work")
    with pytest.raises(ConfigError, match=r"needs pycolmap and torch; run: .*reconstruct"):
        reconstruct_scene(job, CONFIG, lambda _: None)
    assert not job.work.exists()


def test_missing_gpu_is_told_before_anything_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(kernels: str, device: str) -> None:
        raise ConfigError(f"{kernels} on {device}: there is none")

    monkeypatch.setattr(module, "require_kernels", none)
    job = Job(source=tmp_path / "walk.mp4", out=tmp_path / "lobby", work=tmp_path / "work")
    with pytest.raises(ConfigError, match="gsplat on cuda: there is none"):
        reconstruct_scene(job, replace(CONFIG, gaussians=replace(CONFIG.gaussians, device="cuda")), lambda _: None)
    assert not job.work.exists()


def test_search_for_what_moved_is_told_before_the_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch", reason="torch is not installed")
    from readygo.services.reconstructor.training import train
    from readygo.services.reconstructor.training.progress import TrainingProgress

    def run(posed: Path, folder: Path, settings: Any, tell: Any) -> dict[str, Any]:
        assert (posed, folder) == (tmp_path / "posed", tmp_path / "out")
        at = TrainingProgress(
            step=30, steps=90, gaussians=1234, loss=0.1, psnr_db=25.04, seconds=3.0, picture=None, searches=True
        )
        tell(at)
        tell(replace(at, searches=False))
        return {}

    monkeypatch.setattr(train, "train_gaussians", run)
    heard: list[Any] = []
    module._training(tmp_path, CONFIG, heard.append)(tmp_path / "out")
    assert [(said.share, said.words) for said in heard] == [
        (0.0, "searching for what moved, step 30 of 90"),
        (1 / 3, "step 30 of 90, 1,234 Gaussians, 25.0 dB"),
    ]


def test_training_is_resumed_with_the_code_that_began_it_alone(
    tmp_path: Path, trained: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    job = Job(source=Path("walk.mp4"), out=tmp_path / "lobby", work=tmp_path / "lobby.work")
    for parts in (("training",), ("differentiable",), ()):
        monkeypatch.setattr(module, "code_digest", lambda *of, new=parts: str([part in new for part in sorted(of)]))
        reconstruct_scene(job, CONFIG, lambda progress: None)
    assert trained == ["train"] * 3
