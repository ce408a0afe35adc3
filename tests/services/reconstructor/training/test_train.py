"""Trainings of a small scene, whole and interrupted."""

import json
import os
import resource
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.arrays import Int64Array
from readygo.common.errors import RunError, SceneError
from readygo.common.gaussians.files import read_gaussians
from readygo.services.reconstructor.training import density, schedule, train
from readygo.services.reconstructor.training.config import (
    DensityConfig,
    GaussiansConfig,
    GeometryConfig,
)
from readygo.services.reconstructor.training.cpu import CpuEngine
from readygo.services.reconstructor.training.photos import PhotoStore
from readygo.services.reconstructor.training.progress import TrainingProgress
from readygo.services.reconstructor.training.train import train_gaussians
from tests.services.reconstructor.training.conftest import rig_frames

SETTINGS = GaussiansConfig(
    steps=40,
    hold_out=5,
    sh_degree=1,
    density=DensityConfig(count_max=200),
)
MCMC = replace(SETTINGS, density=replace(SETTINGS.density, method="mcmc"))
SURFACES = replace(SETTINGS, geometry=GeometryConfig(enabled=True, flatten=1.0))

Write = Callable[[Path], Path]

pytestmark = pytest.mark.usefixtures("few_steps")


def silent(_: TrainingProgress) -> None:
    """Hears nothing."""


@pytest.mark.parametrize("settings", [SETTINGS, MCMC, SURFACES], ids=["gradients", "mcmc", "surfaces"])
def test_training_shows_held_out_images_better(write_posed: Write, tmp_path: Path, settings: GaussiansConfig) -> None:
    posed = write_posed(tmp_path / "posed")
    before = train_gaussians(posed, tmp_path / "before", replace(settings, steps=1), silent)
    after = train_gaussians(posed, tmp_path / "after", settings, silent)
    assert after["psnr_db"] > before["psnr_db"] + 1.5
    assert [row["image"] for row in after["held_out"]] == ["0.png", "5.png"]
    assert 80 <= len(read_gaussians(tmp_path / "after" / "gaussians.ply")) <= 200
    assert sorted(p.name for p in (tmp_path / "after" / "previews").iterdir()) == ["000025.png", "held_out"]
    assert not list((tmp_path / "after").glob("checkpoint*"))


def test_interrupted_training_comes_to_the_same_result(
    write_posed: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    posed = write_posed(tmp_path / "posed")
    train_gaussians(posed, tmp_path / "whole", MCMC, silent)
    monkeypatch.setattr(train, "_TELL_EVERY_S", 0.0)

    def interrupt(at: TrainingProgress) -> None:
        if at.step == 23:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        train_gaussians(posed, tmp_path / "parts", MCMC, interrupt)
    assert not (tmp_path / "parts" / "gaussians.ply").exists()
    heard: list[int] = []
    train_gaussians(posed, tmp_path / "parts", MCMC, lambda at: heard.append(at.step))
    assert heard[0] == 25
    files = [(tmp_path / name / "gaussians.ply").read_bytes() for name in ("whole", "parts")]
    assert files[0] == files[1]


def test_full_disk_is_one_line_and_the_training_goes_on_when_there_is_room(
    write_posed: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    posed, settings = write_posed(tmp_path / "posed"), replace(SETTINGS, steps=4)
    monkeypatch.setattr(train, "_SAVE_EVERY_S", 0.0)
    monkeypatch.setattr(train, "_TELL_EVERY_S", 0.0)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    began: list[int] = []

    def fill(at: TrainingProgress) -> None:
        began.append(at.step)
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))

    try:
        with pytest.raises(RunError, match=r"^The disk of .*out is full.*Make room and run the same command again"):
            train_gaussians(posed, tmp_path / "out", settings, fill)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [".lock", "checkpoint.npz"]
    train_gaussians(posed, tmp_path / "out", settings, lambda at: began.append(at.step))
    assert began == [1, 2, 3, 4]


def test_what_no_training_image_shows_is_left_out_in_the_end(write_posed: Write, tmp_path: Path) -> None:
    posed = write_posed(tmp_path / "posed")
    points = posed / "sparse" / "0" / "points3D.txt"
    behind = [f"{900 + k} {0.1 * k} 0 -{3 + 0.1 * k} 9 9 9 0.5" for k in range(7)]
    points.write_text(points.read_text() + "\n".join(behind) + "\n")
    report = train_gaussians(posed, tmp_path / "out", replace(SETTINGS, steps=2), silent)
    cloud = read_gaussians(tmp_path / "out" / "gaussians.ply")
    assert (report["unseen"], len(cloud)) == (7, 150)
    assert (cloud.means_m[:, 2] > 0).all()


def test_finished_training_is_not_done_again(write_posed: Write, tmp_path: Path) -> None:
    posed, settings = write_posed(tmp_path / "posed"), replace(SETTINGS, steps=2)
    first = train_gaussians(posed, tmp_path / "out", settings, silent)
    again = train_gaussians(posed, tmp_path / "out", settings, lambda _: pytest.fail("trained again"))
    assert json.loads(json.dumps(first)) == again


def test_other_settings_are_refused_where_a_training_is_under_way(
    write_posed: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    posed = write_posed(tmp_path / "posed")
    monkeypatch.setattr(train, "_TELL_EVERY_S", 0.0)
    with pytest.raises(KeyboardInterrupt):
        train_gaussians(posed, tmp_path / "out", SETTINGS, lambda _: os.kill(os.getpid(), signal.SIGINT))
    with pytest.raises(RunError, match="other settings"):
        train_gaussians(posed, tmp_path / "out", replace(SETTINGS, seed=1), silent)


def test_numbers_that_are_not_finite_stop_and_keep_the_last_state(
    write_posed: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    posed = write_posed(tmp_path / "posed")
    monkeypatch.setattr(train, "_SAVE_EVERY_S", 0.0)
    monkeypatch.setattr(schedule, "COLOURS_RATE", 1e38)
    with pytest.raises(RunError, match=r"Step \d+: .* not finite; the state of step \d+ is kept"):
        train_gaussians(posed, tmp_path / "out", SETTINGS, silent)
    with np.load(tmp_path / "out" / "checkpoint.npz") as file:
        assert np.isfinite(file["value_means_m"]).all()


def test_vanished_gaussians_stop_the_training(
    write_posed: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(density, "SCALE_MAX", 1e-4)
    with pytest.raises(RunError, match="no Gaussian is left"):
        train_gaussians(write_posed(tmp_path / "posed"), tmp_path / "out", SETTINGS, silent)


def test_folders_without_a_model_are_refused(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    with pytest.raises(SceneError, match="sparse/0"):
        train_gaussians(tmp_path, tmp_path / "out", SETTINGS, silent)


def test_missing_images_are_refused(write_posed: Write, tmp_path: Path) -> None:
    posed = write_posed(tmp_path / "posed")
    (posed / "images" / "3.png").unlink()
    with pytest.raises(SceneError, match=r"lacks 1 images of the model, 3.png"):
        train_gaussians(posed, tmp_path / "out", SETTINGS, silent)


def test_surfaces_without_a_neighbour_are_told(write_posed: Write, tmp_path: Path) -> None:
    posed = write_posed(tmp_path / "posed")
    few = replace(SURFACES, steps=1)
    report = train_gaussians(posed, tmp_path / "out", few, silent)
    assert (report["without_neighbour"], report["notes"]) == (0, [])
    near = replace(few, geometry=replace(few.geometry, distance_max_m=0.1))
    report = train_gaussians(posed, tmp_path / "near", near, silent)
    assert report["without_neighbour"] == 4
    (note,) = report["notes"]
    assert note.startswith("4 of 4 training images have no neighbour")


def test_views_of_one_moment_count_as_one_where_gaussians_are_trimmed(
    write_posed: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    posed, asked, seen_by = write_posed(tmp_path / "posed"), [], CpuEngine.seen_by
    rig_frames(posed / "sparse" / "0")

    def watched(engine: CpuEngine, photos: PhotoStore, groups: list[list[int]], pixels_min: float) -> Int64Array:
        asked.append(groups)
        return seen_by(engine, photos, groups, pixels_min)

    monkeypatch.setattr(CpuEngine, "seen_by", watched)
    train_gaussians(posed, tmp_path / "out", replace(SURFACES, steps=4, hold_out=0), silent)
    assert len(asked) == 3, "after the first two steps, and at the end"
    assert all(groups == [[0, 3], [1, 4], [2, 5]] for groups in asked)


def show_intruder(posed: Path, value: int) -> Path:
    """Put a thing of one grey into all photos, elsewhere in each, with masks of it in `masked_away`."""
    (posed / "masked_away").mkdir()
    for number in range(6):
        mask = np.full((36, 48), 255, np.uint8)
        mask[8:30, 5 + 6 * number : 15 + 6 * number] = 0
        path = posed / "images" / f"{number}.png"
        photo = cv2.imread(str(path))
        photo[mask == 0] = value
        cv2.imwrite(str(path), photo)
        cv2.imwrite(str(posed / "masked_away" / f"{number}.png.png"), mask)
    return posed


def test_what_is_masked_has_no_influence_at_all(write_posed: Write, tmp_path: Path) -> None:
    settings, files = replace(SETTINGS, steps=6, hold_out=0), []
    for value in (0, 255):
        posed = show_intruder(write_posed(tmp_path / f"posed{value}"), value)
        (posed / "masked_away").rename(posed / "masks")
        train_gaussians(posed, tmp_path / f"out{value}", settings, silent)
        files.append((tmp_path / f"out{value}" / "gaussians.ply").read_bytes())
    assert files[0] == files[1]


def test_refused_model_leaves_a_folder_of_the_user_as_it_was(tmp_path: Path) -> None:
    home = tmp_path / "home"
    (home / ".conf").mkdir(parents=True)
    with pytest.raises(SceneError, match="needs images/ and a COLMAP model"):
        train_gaussians(tmp_path / "nothing", home, GaussiansConfig(), lambda _: None)
    assert [path.name for path in home.iterdir()] == [".conf"]


def test_measured_depths_are_where_gaussians_begin_and_another_depth_is_another_training(
    write_posed: Write, tmp_path: Path
) -> None:
    posed, settings = write_posed(tmp_path / "posed"), replace(SURFACES, steps=1)
    bare = train_gaussians(posed, tmp_path / "bare", settings, silent)
    (posed / "depth").mkdir()
    for number in range(6):
        cv2.imwrite(str(posed / "depth" / f"{number}.png.png"), np.full((36, 48), 2000, np.uint16))
    first = train_gaussians(posed, tmp_path / "out", settings, silent)
    assert bare["gaussians"] == 150
    assert 150 < first["gaussians"] <= 200
    begun = read_gaussians(tmp_path / "out" / "gaussians.ply").means_m[150:]
    assert np.abs(begun[:, 2] - 2.0).max() < 0.02
    assert train_gaussians(posed, tmp_path / "out", settings, silent)["identity"] == first["identity"]
    cv2.imwrite(str(posed / "depth" / "3.png.png"), np.full((36, 48), 1900, np.uint16))
    assert train_gaussians(posed, tmp_path / "out", settings, silent)["identity"] != first["identity"]
