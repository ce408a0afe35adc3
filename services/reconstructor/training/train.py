"""Training of Gaussians from a posed COLMAP model."""

import hashlib
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from readygo.common.arrays import BoolArray, Float64Array, UInt8Array
from readygo.common.config import section_to_mapping
from readygo.common.documents import read_json
from readygo.common.errors import RunError
from readygo.common.files import write_whole
from readygo.common.gaussians.files import read_gaussians
from readygo.common.gaussians.ply import save_ply
from readygo.services.reconstructor.stages import Stages, word_errors
from readygo.services.reconstructor.training.batches import batch_views
from readygo.services.reconstructor.training.between import points_between
from readygo.services.reconstructor.training.checkpoint import CHECKPOINT_FILE, load_checkpoint, save_checkpoint
from readygo.services.reconstructor.training.config import GaussiansConfig
from readygo.services.reconstructor.training.cpu import CpuEngine
from readygo.services.reconstructor.training.density import (
    NOISE,
    Sightings,
    changed_density,
    make_faint,
    reset_opacities,
)
from readygo.services.reconstructor.training.drawing import OBSERVED_PX
from readygo.services.reconstructor.training.engine import Engine, ViewTask
from readygo.services.reconstructor.training.exposures import Exposures
from readygo.services.reconstructor.training.interruption import interruption
from readygo.services.reconstructor.training.measured import points_of_depths
from readygo.services.reconstructor.training.memory import check_memory, gpu_memory
from readygo.services.reconstructor.training.neighbours import choose_neighbours, neighbour_distances
from readygo.services.reconstructor.training.parameters import Gaussians, initial_gaussians
from readygo.services.reconstructor.training.photos import (
    PhotoStore,
    Posed,
    model_of,
    open_posed,
    split_views,
    views_by_moment,
)
from readygo.services.reconstructor.training.progress import Tell, TrainingProgress
from readygo.services.reconstructor.training.schedule import TrainingSchedule
from readygo.services.reconstructor.training.score import PREVIEWS, HeldOut, measure, picture_name, write_picture
from readygo.services.reconstructor.training.transients import Transients, find_transients

CLOUD_FILE, REPORT_FILE, UNDISTORTED = "gaussians.ply", "training.json", "pinhole"
_PREVIEW_EVERY = 500
"""Steps from one held-out picture and measurement to the next."""
_EXPOSURES_RATE = 1e-3
"""Learning rate of the gains and offsets of each training image (photos of one automatic exposure differ)."""
_SURFACES_BEGIN = 0.23
"""Share of the training after which normals and neighbours are compared; Gaussians are flattened from the start."""
_NEIGHBOURS, _NEIGHBOUR_ANGLE_MAX_DEG, _NEIGHBOUR_DISTANCE_MIN_M = 8, 30.0, 0.01
"""Views that a view is compared with (as PGSR): most of them, largest angle [deg], least distance [m]."""
_ALONE_MAX = 0.1
"""A larger share of images without a neighbour is worth a note."""
_TRIM_MOMENTS = 2
"""Gaussians of surfaces must be seen at this many moments: views of one moment, as those that a 360-degree image is cut
into, have one place."""
_SAVE_EVERY_S = 120.0
_TELL_EVERY_S = 1.0
_OPACITY = {"gradients": 0.1, "mcmc": 0.5}


def train_gaussians(posed_folder: Path, out_folder: Path, settings: GaussiansConfig, progress: Tell) -> dict[str, Any]:
    """Train Gaussians; resume an interrupted call with the same arguments, to the same result.

    Args:
        posed_folder: `images/` and `sparse/0/`, as `readygo scene poses` leaves them in `posed`; or any COLMAP model.
        out_folder: Gets `gaussians.ply`, `training.json` (the report), `previews/` and, until it is done,
            `checkpoint.npz`.
        settings: How; see `preset`.
        progress: Is told about every second how far it is.

    Without masks, and with `settings.transients`, pixels of what moved are searched first (`find_transients`) and
    ignored, as those of given masks are.

    Returns:
        The report: `psnr_db`, `psnr_fitted_db` (after an affine fit of each image's colours) and `ssim` (means of the
        held-out images, None without any), `held_out` (by image),
        `gaussians`, `unseen` (how many were left out in the end as no training image shows them), `images`,
        `transients` (`share` of the pixels, `photos` with any, whether they are `ignored`; None without a search),
        `without_neighbour` (training images whose surfaces are compared with no other image), `notes` (in words),
        `seconds` (by stage), `gpu_bytes` (most memory of a GPU that tensors held since the last start), `settings`.

    Raises:
        ReadygoError: If the model or its images cannot be used, numbers stop being finite, memory or the disk do not
            suffice.
        KeyboardInterrupt: At Ctrl-C, after the state is saved.
    """
    # Before the folder is touched, which may be one of the user's.
    model_of(posed_folder)
    with Stages(out_folder, lambda _: None).alone():
        posed = open_posed(posed_folder, out_folder / UNDISTORTED)
        identity = _identity(posed, settings)
        done = _finish_training(out_folder, identity)
        if done is not None:
            return done
        check_memory(posed, settings)
        with word_errors(out_folder), gpu_memory(settings):
            transients = None
            if settings.transients and posed.masks is None:
                transients = find_transients(posed, out_folder, settings, identity, _fit, progress)
            if transients is not None and transients.ignored:
                posed = replace(posed, masks=transients.masks)
            with closing(_engine_of(settings)) as engine:
                return _Training(posed, out_folder, settings, identity, progress, engine).run(transients)


def _fit(posed: Posed, folder: Path, settings: GaussiansConfig, progress: Tell) -> Gaussians:
    """Gaussians of some photos; resume an interrupted call, and do not repeat a finished one."""
    identity = _identity(posed, settings)
    if _finish_training(folder, identity) is None:
        with closing(_engine_of(settings)) as engine:
            _Training(posed, folder, settings, identity, progress, engine).run()
    return Gaussians.of_cloud(read_gaussians(folder / CLOUD_FILE))


def _engine_of(settings: GaussiansConfig) -> Engine:
    if settings.device == "cpu":
        return CpuEngine(settings)
    from readygo.services.reconstructor.training.cuda import cuda_engine

    return cuda_engine(settings)


def _identity(posed: Posed, settings: GaussiansConfig) -> str:
    digest = hashlib.sha256(json.dumps(section_to_mapping(settings), sort_keys=True).encode())
    for number, name in enumerate(posed.views.images):
        digest.update(f"{name} {(posed.folder / name).stat().st_size}".encode())
        digest.update(posed.views.T_world_camera[number].tobytes() + posed.views.K_px[number].tobytes())
        if posed.masks is not None:
            digest.update((posed.masks / f"{name}.png").read_bytes())
        depth = None if posed.depths is None else posed.depths / f"{name}.png"
        digest.update(depth.read_bytes() if depth is not None and depth.is_file() else b"")
    digest.update(posed.points_m.tobytes())
    return digest.hexdigest()


def _finish_training(folder: Path, identity: str) -> dict[str, Any] | None:
    try:
        report = read_json(folder / REPORT_FILE)
    except (OSError, ValueError):
        return None
    same = isinstance(report, dict) and report.get("identity") == identity and (folder / CLOUD_FILE).is_file()
    return report if same else None


class _Training:
    """A training under way."""

    def __init__(
        self, posed: Posed, folder: Path, settings: GaussiansConfig, identity: str, tell: Tell, engine: Engine
    ) -> None:
        self._posed, self._folder, self._settings, self._identity, self._tell = posed, folder, settings, identity, tell
        self._engine = engine
        self._train, self._held = split_views(posed.moments, settings.hold_out)
        self._by_moment = views_by_moment(posed.moments, self._train)
        self._schedule = TrainingSchedule(settings, posed.extent_m)
        self._seconds: dict[str, float] = {}
        self._step, self._loss, self._saved_step = 0, math.nan, 0
        self._unseen = 0
        self._psnr_db: float | None = None
        self._picture: Path | None = None
        self._photos: PhotoStore | None = None
        self._fraction = 0
        self._neighbours = _neighbours_of(posed, self._train, settings)
        self._start()

    def _start(self) -> None:
        """Begin or resume the training."""
        found = load_checkpoint(self._folder, self._identity)
        if found is None:
            points_m, points_rgb = self._points()
            opacity = _OPACITY[self._settings.density.method]
            gaussians = initial_gaussians(points_m, points_rgb, self._settings.sh_degree, opacity)
            self._exposures = Exposures.none(len(self._posed.views))
            self._engine.load(gaussians, Sightings.none(len(gaussians)))
            return
        numbers, arrays = found
        self._step = self._saved_step = int(numbers["step"])
        self._seconds = dict(numbers["seconds"])
        self._exposures = Exposures(arrays.pop("exposures"), arrays.pop("exposure_moments"))
        seen = Sightings(arrays.pop("seen_gradient"), arrays.pop("seen_views"))
        self._engine.load(Gaussians.from_state(arrays), seen)

    def _points(self) -> tuple[Float64Array, UInt8Array]:
        """Positions and colours that Gaussians begin with."""
        posed, room = self._posed, self._settings.density.count_max - len(self._posed.points_m)
        if room <= 0:
            return posed.points_m, posed.points_rgb
        more = points_between if posed.depths is None else points_of_depths
        more_m, more_rgb = more(posed, self._train, room)
        return np.concatenate([posed.points_m, more_m]), np.concatenate([posed.points_rgb, more_rgb])

    def run(self, transients: Transients | None = None) -> dict[str, Any]:
        """Train to the end and write what came of it.

        Args:
            transients: What was found before, for the report.
        """
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            with interruption() as interrupted:
                self._steps(interrupted)
                with self._clock("density"):
                    unseen = self._rarely_seen(self._photos_of(1), 1)
                    gaussians, self._unseen = self._engine.arrays()[0].select(~unseen), int(unseen.sum())
                    self._check_some_left(len(gaussians))
                    self._engine.load(gaussians, Sightings.none(len(gaussians)))
        finally:
            torch.set_num_threads(threads)
        return self._finish(transients)

    def _steps(self, interrupted: Callable[[], bool]) -> None:
        saved_s = told_s = time.monotonic()
        while self._step < self._settings.steps:
            self._one_step()
            self._step += 1
            if self._step % _PREVIEW_EVERY == 0:
                self._preview()
            now_s = time.monotonic()
            if interrupted() or now_s - saved_s > _SAVE_EVERY_S:
                self._save()
                saved_s = now_s
            if interrupted():
                raise KeyboardInterrupt
            if now_s - told_s > _TELL_EVERY_S or self._step == self._settings.steps:
                self._say()
                told_s = now_s

    def _one_step(self) -> None:
        step, schedule, engine = self._step, self._schedule, self._engine
        with self._clock("photos"):
            photos = self._photos_of(schedule.fraction(step))
        numbers = batch_views(self._train, step, self._settings.batch, self._settings.seed)
        with self._clock("views"):
            tasks = [self._task(number, slot) for slot, number in enumerate(numbers)]
            views = engine.views(photos, tasks, schedule.sh_degree(step))
        self._loss = float(np.mean([view.loss for view in views]))
        if not math.isfinite(self._loss):
            self._stop_at_nan(f"images {', '.join(self._posed.views.images[number] for number in numbers)}")
        with self._clock("optimiser"):
            engine.change(schedule.rates(step))
            self._exposures.step(numbers, [view.exposure for view in views], _EXPOSURES_RATE, self._train)
        with self._clock("density"):
            if schedule.trims(step):
                hidden = self._rarely_seen(photos, _TRIM_MOMENTS)
                self._edit(lambda gaussians: make_faint(gaussians, hidden, self._settings.density))
            self._change_density()

    def _task(self, number: int, slot: int) -> ViewTask:
        """What the view at a place of this step's batch is asked."""
        exposure = self._exposures.values[number]
        if not self._settings.geometry.enabled or self._step < _SURFACES_BEGIN * self._settings.steps:
            return ViewTask(number=number, exposure=exposure, rng=None, neighbour=None)
        rng = np.random.default_rng((self._settings.seed, self._step, 2, slot))
        others = self._neighbours[number]
        neighbour = others[rng.integers(len(others))] if others else None
        return ViewTask(number=number, exposure=exposure, rng=rng, neighbour=neighbour)

    def _photos_of(self, fraction: int) -> PhotoStore:
        if self._photos is None or fraction != self._fraction:
            self._photos = None
            self._photos = PhotoStore(self._posed, self._train, self._settings.side_max_px, fraction)
            self._fraction = fraction
        return self._photos

    def _change_density(self) -> None:
        density, schedule, step = self._settings.density, self._schedule, self._step
        rng = np.random.default_rng((self._settings.seed, step))
        if density.method == "mcmc":
            self._engine.add_noise(schedule.means_rate_m(step) * NOISE, rng)
        if schedule.changes_density(step):
            self._check_finite()
            change = changed_density(*self._engine.shapes(), density, self._posed.extent_m, rng)
            self._check_some_left(len(change))
            self._engine.rebuild(change)
        if schedule.resets_opacities(step):
            self._edit(lambda gaussians: reset_opacities(gaussians, density))

    def _edit(self, change: Callable[[Gaussians], None]) -> None:
        """Change the Gaussians in place."""
        gaussians, seen = self._engine.arrays()
        change(gaussians)
        self._engine.load(gaussians, seen)

    def _rarely_seen(self, photos: PhotoStore, moments_min: int) -> BoolArray:
        """True for Gaussians that training views of fewer than `moments_min` moments show, shape (N,)."""
        # What is small on a reduced image may be what a whole one needs.
        pixels_min = OBSERVED_PX / self._fraction**2
        return self._engine.seen_by(photos, self._by_moment, pixels_min) < moments_min

    def _check_some_left(self, count: int) -> None:
        if not count:
            raise RunError(
                f"Step {self._step}: no Gaussian is left: all were faint, large for how far the cameras are apart "
                f"({self._posed.extent_m:.3g} m), or seen by too few images; look at the poses, or at the settings."
            )

    def _check_finite(self) -> None:
        name = self._engine.not_finite()
        if name is not None:
            self._stop_at_nan(name)

    def _stop_at_nan(self, what: str) -> None:
        kept = f"the state of step {self._saved_step} is kept" if self._saved_step else "nothing was saved yet"
        raise RunError(
            f"Step {self._step}: {what} gave a number that is not finite; {kept} in {self._folder}. "
            f"Start again with smaller learning rates, or look at the images and poses."
        )

    def _preview(self) -> None:
        with self._clock("measuring"):
            scores = measure(self._engine.arrays()[0], self._held_photos(8), self._settings.sh_degree)
            if not scores:
                return
            self._psnr_db = float(np.mean([score.psnr_db for score in scores]))
            self._picture = self._folder / PREVIEWS / f"{self._step:06d}.png"
            write_picture(self._picture, scores[0])

    def _held_photos(self, count_max: int) -> PhotoStore | None:
        numbers = self._held[:count_max]
        return PhotoStore(self._posed, numbers, self._settings.side_max_px, 1) if numbers else None

    def _save(self) -> None:
        with self._clock("checkpoints"):
            self._check_finite()
            gaussians, seen = self._engine.arrays()
            arrays = {
                **gaussians.state(),
                "exposures": self._exposures.values,
                "exposure_moments": self._exposures.moments,
                "seen_gradient": seen.gradient,
                "seen_views": seen.views,
            }
            save_checkpoint(self._folder, self._identity, {"step": self._step, "seconds": self._seconds}, arrays)
            self._saved_step = self._step

    def _finish(self, transients: Transients | None) -> dict[str, Any]:
        self._check_finite()
        gaussians = self._engine.arrays()[0]
        with self._clock("measuring"):
            scores = measure(gaussians, self._held_photos(len(self._held)), self._settings.sh_degree)
            for score in scores:
                write_picture(self._folder / PREVIEWS / "held_out" / picture_name(score.image), score)
        save_ply(gaussians.cloud(), self._folder / CLOUD_FILE)
        report = self._report(scores, transients)
        write_whole(self._folder / REPORT_FILE, json.dumps(report, indent=1) + "\n", raises=RunError)
        (self._folder / CHECKPOINT_FILE).unlink(missing_ok=True)
        return report

    def _report(self, scores: list[HeldOut], transients: Transients | None) -> dict[str, Any]:
        names = ("psnr_db", "psnr_fitted_db", "ssim")
        rows = [{"image": score.image, **{name: getattr(score, name) for name in names}} for score in scores]
        return {
            **{name: float(np.mean([row[name] for row in rows])) if rows else None for name in names},
            "held_out": rows,
            "gaussians": len(self._engine),
            "unseen": self._unseen,
            "images": len(self._train),
            "transients": None if transients is None else transients.report,
            "without_neighbour": sum(not others for others in self._neighbours.values()),
            "notes": [*_neighbour_notes(self._neighbours), *([] if transients is None else transients.notes)],
            "seconds": {
                **({} if transients is None else {"transients": transients.seconds}),
                **{name: round(spent_s, 2) for name, spent_s in self._seconds.items()},
            },
            "gpu_bytes": self._engine.gpu_bytes,
            "settings": section_to_mapping(self._settings),
            "identity": self._identity,
        }

    def _say(self) -> None:
        self._tell(
            TrainingProgress(
                step=self._step,
                steps=self._settings.steps,
                gaussians=len(self._engine),
                loss=self._loss,
                psnr_db=self._psnr_db,
                seconds=sum(self._seconds.values()),
                picture=self._picture,
            )
        )

    @contextmanager
    def _clock(self, stage: str) -> Iterator[None]:
        begin_s = time.monotonic()
        yield
        self._seconds[stage] = self._seconds.get(stage, 0.0) + time.monotonic() - begin_s


def _neighbours_of(posed: Posed, train: tuple[int, ...], settings: GaussiansConfig) -> dict[int, tuple[int, ...]]:
    """Numbers of the training views that each training view is compared with, by its number."""
    config = settings.geometry
    if not config.enabled:
        return {}
    T_world_camera, farthest_m = posed.views.T_world_camera[list(train)], np.full(len(train), config.distance_max_m)
    if not config.distance_max_m:
        farthest_m = neighbour_distances(
            T_world_camera,
            posed.depth_m,
            angle_max_deg=_NEIGHBOUR_ANGLE_MAX_DEG,
            distance_min_m=_NEIGHBOUR_DISTANCE_MIN_M,
        )
    found = choose_neighbours(
        T_world_camera,
        angle_max_deg=_NEIGHBOUR_ANGLE_MAX_DEG,
        distance_m=(_NEIGHBOUR_DISTANCE_MIN_M, farthest_m),
        count=_NEIGHBOURS,
    )
    return {number: tuple(train[k] for k in others) for number, others in zip(train, found, strict=True)}


def _neighbour_notes(neighbours: Mapping[int, tuple[int, ...]]) -> list[str]:
    """What there is to say where surfaces of many images are compared with nothing."""
    alone = sum(not others for others in neighbours.values())
    if alone <= _ALONE_MAX * len(neighbours):
        return []
    return [
        f"{alone} of {len(neighbours)} training images have no neighbour that looks the same way near by: their "
        "surfaces are compared with no other image; film with smaller steps, or raise geometry.distance_max_m"
    ]
