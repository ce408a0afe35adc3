"""A posed model of a small scene whose truth is known."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from readygo.common.drawing.files import quantise, write_png
from readygo.services.reconstructor.training import density, schedule, train
from readygo.services.reconstructor.training.drawing import draw, leaves_of, planes_of
from readygo.services.reconstructor.training.parameters import Gaussians, initial_gaussians
from readygo.services.reconstructor.training.photos import Photo

SIZE_PX = (36, 48)
FOCAL_PX = 45.0
VIEWS = 6


def true_gaussians() -> Gaussians:
    """Coloured blobs on a wall 2 m away."""
    rng = np.random.default_rng(3)
    points = np.stack([rng.uniform(-1.3, 1.3, 150), rng.uniform(-1.0, 1.0, 150), rng.uniform(1.9, 2.1, 150)], axis=1)
    gaussians = initial_gaussians(points, rng.integers(0, 256, (150, 3)).astype(np.uint8), 0, 0.8)
    gaussians.values["log_scales"][:] = np.log(0.12)
    return gaussians


def camera(number: int) -> Photo:
    """The camera of a view, without its photo."""
    T = np.eye(4)
    T[0, 3] = 0.12 * number - 0.3
    K = np.array([[FOCAL_PX, 0, SIZE_PX[1] / 2], [0, FOCAL_PX, SIZE_PX[0] / 2], [0, 0, 1]])
    return Photo(rgb=np.zeros((3, *SIZE_PX), np.float32), K_px=K, T_world_camera=T)


def rig_frames(model: Path) -> None:
    """Make images 0 and 3, 1 and 4, 2 and 5 of a model views of a rig, 0.36 m apart."""
    lens = (model / "cameras.txt").read_text().partition(" ")[2]
    (model / "cameras.txt").write_text(f"1 {lens}2 {lens}")
    lines = (model / "images.txt").read_text().splitlines()
    for row in (6, 8, 10):
        columns = lines[row].split()
        lines[row] = " ".join([*columns[:8], "2", columns[9]])
    (model / "images.txt").write_text("\n".join(lines) + "\n")
    (model / "rigs.txt").write_text("1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 -0.36 0 0\n")
    frames = [f"{k + 1} 1 1 0 0 0 {0.3 - 0.12 * k} 0 0 2 CAMERA 1 {k + 1} CAMERA 2 {k + 4}" for k in range(3)]
    (model / "frames.txt").write_text("\n".join(frames) + "\n")


@pytest.fixture
def few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """A training of 40 steps in which all happens that happens in thousands."""
    for name, value in {
        "COARSE": 2, "COARSE_END": 0.2, "CHANGE_EVERY": 10, "CHANGE_BEGIN": 0.1, "RESET_EVERY": 1.0, "TRIM_EVERY": 0.25,
    }.items():  # fmt: skip
        monkeypatch.setattr(schedule, name, value)
    monkeypatch.setattr(density, "SCALE_MAX", 5.0)
    monkeypatch.setattr(train, "_PREVIEW_EVERY", 25)
    monkeypatch.setattr(train, "_SURFACES_BEGIN", 0.5)


@pytest.fixture(scope="session")
def write_posed() -> Callable[[Path], Path]:
    """Writes images/ and a COLMAP text model to a folder, which it gives back."""
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    gaussians = true_gaussians()
    leaves = leaves_of(gaussians)
    pictures = [quantise(planes_of(draw(leaves, camera(number), 0))) for number in range(VIEWS)]

    def write(folder: Path) -> Path:
        model = folder / "sparse" / "0"
        model.mkdir(parents=True)
        lines = []
        for number, picture in enumerate(pictures):
            write_png(folder / "images" / f"{number}.png", picture)
            lines += [f"{number + 1} 1 0 0 0 {-camera(number).T_world_camera[0, 3]} 0 0 1 {number}.png", ""]
        (model / "images.txt").write_text("\n".join(lines) + "\n")
        height, width = SIZE_PX
        (model / "cameras.txt").write_text(
            f"1 PINHOLE {width} {height} {FOCAL_PX} {FOCAL_PX} {width / 2} {height / 2}\n"
        )
        rows = zip(gaussians.values["means_m"], gaussians.values["sh"], strict=True)
        points = [
            f"{k + 1} {p[0]} {p[1]} {p[2]} {' '.join(str(int(c)) for c in np.clip(127 + 72 * sh, 0, 255))} 0.5"
            for k, (p, sh) in enumerate(rows)
        ]
        (model / "points3D.txt").write_text("\n".join(points) + "\n")
        return folder

    return write
