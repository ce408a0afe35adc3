"""What moved while a place was recorded is found in its photos."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.arrays import Float32Array
from readygo.common.camera.captured import CapturedViews
from readygo.common.drawing.files import quantise, write_png
from readygo.common.errors import RunError
from readygo.services.reconstructor.training import transients
from readygo.services.reconstructor.training.config import DensityConfig, GaussiansConfig, preset
from readygo.services.reconstructor.training.drawing import draw, leaves_of, planes_of
from readygo.services.reconstructor.training.parameters import Gaussians
from readygo.services.reconstructor.training.photos import Posed
from readygo.services.reconstructor.training.progress import Tell, TrainingProgress
from readygo.services.reconstructor.training.train import train_gaussians
from readygo.services.reconstructor.training.transients import (
    Transients,
    find_transients,
    matched,
    region_of,
    usual_difference,
)
from tests.services.reconstructor.training.conftest import SIZE_PX, camera, true_gaussians

VIEWS = 12
MOVED = {2: 4, 5: 14, 7: 30}
"""Left columns of a square in some photos [px]."""
SIDE, TOP = 10, 12


def prediction(
    shift_m: float = 0.0, depth_m: float = 2.0, difference: Float32Array | float = 0.0, moment: int = 1
) -> transients._Prediction:
    """A camera that looks at a wall; that of moment 0 is compared with the others."""
    photo = camera(0)
    T = photo.T_world_camera.copy()
    T[0, 3] = shift_m
    return transients._Prediction(
        K_px=photo.K_px,
        T_world_camera=T,
        moment=moment,
        depth=np.full(SIZE_PX, depth_m, np.float32),
        difference=np.broadcast_to(np.float32(difference), SIZE_PX).copy(),
    )


def square(value: float, rows: slice = slice(10, 22), columns: slice = slice(20, 32)) -> Float32Array:
    """A square in a photo of zeros."""
    image = np.zeros(SIZE_PX, np.float32)
    image[rows, columns] = value
    return image


NOWHERE = np.zeros(SIZE_PX, np.float32)


def test_region_is_what_differs_much_more_than_usual_and_what_hangs_together_with_it() -> None:
    difference = square(0.3)
    difference[10:22, 32:36] = 0.08
    region = region_of(difference, NOWHERE)
    assert region[10:22, 20:36].all()
    # Two pixels more on each side.
    assert (region.any(axis=1).sum(), region.any(axis=0).sum()) == (16, 20)


@pytest.mark.parametrize(
    ("difference", "usual"),
    [
        (square(0.1), 0.0),
        (square(0.3), 0.2),
        (square(0.9), np.inf),
        (square(0.9, slice(10, 12), slice(10, 12)), 0.0),
    ],
    ids=["weak", "usual", "unknown", "small"],
)
def test_other_differences_are_no_transients(difference: Float32Array, usual: float) -> None:
    assert not region_of(difference, np.full(SIZE_PX, usual, np.float32)).any()


def test_small_holes_belong_to_the_region_and_bays_of_the_border_do_not() -> None:
    hole = square(0.5)
    hole[14:18, 24:28] = 0.0
    assert region_of(hole, NOWHERE)[10:22, 20:32].all()
    large = square(0.5, slice(2, 34), slice(4, 44))
    large[8:28, 10:38] = 0.0
    assert not region_of(large, NOWHERE)[12:24, 14:34].any()
    for place, filled in ((slice(4, 10), True), (slice(0, 6), False)):
        bay = square(0.5, slice(0, 36), slice(10, 40))
        bay[place, 22:27] = 0.0
        assert region_of(bay, NOWHERE)[place.start, 24] == filled


def test_exposure_is_taken_out_although_a_fifth_of_the_photo_differs() -> None:
    rng = np.random.default_rng(0)
    image = rng.uniform(0.2, 0.6, (3, *SIZE_PX)).astype(np.float32)
    gains, offsets = np.array([1.3, 0.8, 1.0]), np.array([-0.05, 0.1, 0.02])
    photo = (image * gains[:, None, None] + offsets[:, None, None]).astype(np.float32)
    photo[:, :, :10] = 1.0
    np.testing.assert_allclose(matched(image, photo)[:, :, 10:], photo[:, :, 10:], atol=1e-3)


def test_gains_are_limited_and_a_grey_image_has_none() -> None:
    image = np.linspace(0.4, 0.5, 3 * SIZE_PX[0] * SIZE_PX[1], dtype=np.float32).reshape(3, *SIZE_PX)
    photo = (5.0 * (image - image.mean()) + 0.5).astype(np.float32)
    spread = float(np.ptp(matched(image, photo)[0]))
    assert spread == pytest.approx(2.0 * float(np.ptp(image[0])), rel=1e-3)
    grey = matched(np.full_like(image, 0.3), photo)
    assert np.ptp(grey[0]) == 0.0


def test_usual_difference_is_the_median_at_the_points_that_a_photo_shows() -> None:
    # 0.2 m at a depth of 2 m are 4.5 px.
    others = [prediction(0.2, difference=value) for value in (0.1, 0.5, 0.3)]
    usual = usual_difference([prediction(moment=0), *others], 0)
    assert usual.shape == SIZE_PX
    np.testing.assert_allclose(usual[:, 6:], 0.3)
    assert np.isinf(usual[:, :4]).all()


def test_points_that_too_few_others_show_have_no_usual_difference() -> None:
    two = [prediction(0.2, difference=0.1)] * 2
    assert np.isinf(usual_difference([prediction(moment=0), *two], 0)).all()
    hidden = [prediction(0.2, depth_m=1.0, difference=0.1)] * 5
    assert np.isinf(usual_difference([prediction(moment=0), *hidden], 0)).all()
    away = prediction(0.2)
    away.T_world_camera[:3, :3] = np.diag([-1.0, 1.0, -1.0])
    assert np.isinf(usual_difference([prediction(moment=0), *[away] * 5], 0)).all()
    assert np.isinf(usual_difference([prediction(moment=0)], 0)).all()


def test_other_views_of_one_360_degree_image_do_not_tell_what_is_usual() -> None:
    siblings = [prediction(difference=0.5, moment=0)] * 5
    assert np.isinf(usual_difference([prediction(moment=0), *siblings], 0)).all()
    others = [prediction(difference=0.1, moment=moment) for moment in (1, 2, 3)]
    np.testing.assert_allclose(usual_difference([prediction(moment=0), *siblings, *others], 0), 0.1)


def test_difference_is_that_of_the_place_not_of_the_pixel() -> None:
    edge = square(0.4, slice(0, 36), slice(20, 22))
    usual = usual_difference([prediction(moment=0), *[prediction(0.2, difference=edge)] * 3], 0)
    # A camera that is 4.5 px to the right shows the edge 4.5 px farther left than the photo.
    assert usual[:, 24:26].max() == pytest.approx(0.4)
    assert usual[:, 18:22].max() == 0.0


def test_many_others_are_thinned_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transients, "_OTHERS", 3)
    others = [prediction(0.01, difference=0.1 * k) for k in range(7)]
    usual = usual_difference([prediction(moment=0), *others], 0)
    assert usual[:, 8:].max() == pytest.approx(0.3)


@pytest.fixture
def walked(tmp_path: Path) -> Posed:
    """Photos of a wall past which a square moves."""
    return write_photos(tmp_path / "photos", VIEWS)


def write_photos(folder: Path, count: int) -> Posed:
    """Photos of the wall; a bright square is before it in some."""
    leaves = leaves_of(true_gaussians())
    for number in range(count):
        picture = quantise(planes_of(draw(leaves, camera(number), 0)))
        if number in MOVED:
            picture[TOP : TOP + SIDE, MOVED[number] : MOVED[number] + SIDE] = (255, 0, 255)
        write_png(folder / "a" / f"{number}.jpg", picture)
    gaussians = true_gaussians()
    return Posed(
        views=CapturedViews(
            images=tuple(f"a/{number}.jpg" for number in range(count)),
            sizes_px=np.tile(np.array(SIZE_PX[::-1]), (count, 1)),
            K_px=np.stack([camera(number).K_px for number in range(count)]),
            T_world_camera=np.stack([camera(number).T_world_camera for number in range(count)]),
        ),
        folder=folder,
        points_m=gaussians.values["means_m"].astype(np.float64),
        points_rgb=np.full((len(gaussians), 3), 128, np.uint8),
        seen=np.stack([np.arange(count), np.arange(count)], axis=1),
        moments=np.arange(count),
    )


class Fits:
    """Knows the wall, and what it was asked for."""

    def __init__(self) -> None:
        self.asked: list[tuple[tuple[str, ...], str, int, bool]] = []
        self.sh_degrees: set[int] = set()

    def __call__(self, posed: Posed, folder: Path, settings: GaussiansConfig, progress: Tell) -> Gaussians:
        self.asked.append((posed.views.images, folder.name, settings.steps, posed.masks is not None))
        self.sh_degrees.add(settings.sh_degree)
        folder.mkdir(parents=True)
        for step in (1, settings.steps):
            progress(
                TrainingProgress(
                    step=step, steps=settings.steps, gaussians=1, loss=0.0, psnr_db=None, seconds=0.0, picture=None
                )
            )
        return true_gaussians()


def silent(_: TrainingProgress) -> None:
    """Hears nothing."""


def test_what_moves_is_found_in_two_rounds_of_folds(walked: Posed, tmp_path: Path) -> None:
    fits, heard = Fits(), list[TrainingProgress]()
    out = tmp_path / "out"
    found = find_transients(walked, out, preset("draft"), "one", fits, heard.append)
    assert found is not None
    assert found.photos == len(MOVED)
    for number in range(VIEWS):
        mask = cv2.imread(str(found.masks / "a" / f"{number}.jpg.png"), cv2.IMREAD_UNCHANGED) == 0
        assert mask.shape == SIZE_PX
        if number in MOVED:
            assert mask[TOP : TOP + SIDE, MOVED[number] : MOVED[number] + SIDE].all()
        # The margin, and what smoothing adds.
        assert mask.sum() <= (SIDE + 10) ** 2 * (number in MOVED)
    assert found.share == pytest.approx(len(MOVED) * (SIDE + 6) ** 2 / SIZE_PX[0] / SIZE_PX[1] / VIEWS, rel=0.4)
    assert found.report == {"share": found.share, "photos": 3, "ignored": found.share >= 0.06}
    assert [name for _, name, *_ in fits.asked] == [f"fold_{k}" for k in range(4)] * 2
    assert [steps for *_, steps, _ in fits.asked] == [750] * 4 + [1500] * 4
    assert [masked for *_, masked in fits.asked] == [False] * 4 + [True] * 4
    assert fits.asked[1][0] == tuple(f"a/{k}.jpg.png" for k in range(VIEWS) if k % 4 != 1)
    assert [at.step for at in heard[:4]] == [1, 750, 751, 1500]
    assert (heard[-1].step, heard[-1].steps) == (9000, 9000)
    assert all(at.searches for at in heard)
    assert sorted(path.name for path in (out / "previews" / "transients").iterdir()) == [
        f"a_{number}.png" for number in MOVED
    ]
    assert sorted(path.name for path in (out / "transients").iterdir()) == ["found.json", "masks"]


def test_views_of_one_360_degree_image_are_in_one_fold(walked: Posed, tmp_path: Path) -> None:
    rig = dataclasses.replace(walked.select([*range(10), *range(10)]), moments=np.tile(np.arange(10), 2))
    names = tuple(f"view_{view}/{number}.jpg" for view in range(2) for number in range(10))
    for name in names:
        write_png(walked.folder / name, np.full((*SIZE_PX, 3), 99, np.uint8))
    rig = dataclasses.replace(rig, views=dataclasses.replace(rig.views, images=names))
    fits = Fits()
    find_transients(rig, tmp_path / "out", preset("draft"), "one", fits, silent)
    for fold, (images, *_) in enumerate(fits.asked[:4]):
        assert images == tuple(f"view_{v}/{k}.jpg.png" for v in range(2) for k in range(10) if k % 4 != fold)


@pytest.mark.parametrize(("wanted", "taken"), [(0, 0), (3, 1)])
def test_search_has_at_most_first_degree_colours(walked: Posed, tmp_path: Path, wanted: int, taken: int) -> None:
    fits, settings = Fits(), dataclasses.replace(preset("draft"), steps=8, sh_degree=wanted)
    find_transients(walked, tmp_path / "out", settings, "one", fits, silent)
    assert fits.sh_degrees == {taken}


def test_pictures_show_what_moved_in_red_and_no_earlier_ones_stay(walked: Posed, tmp_path: Path) -> None:
    folder = tmp_path / "out" / "previews" / "transients"
    write_png(folder / "a_11.png", np.zeros((*SIZE_PX, 3), np.uint8))
    find_transients(walked, tmp_path / "out", dataclasses.replace(preset("draft"), steps=8), "one", Fits(), silent)
    assert sorted(path.name for path in folder.iterdir()) == [f"a_{number}.png" for number in MOVED]
    # The square is (255, 0, 255).
    blue, green, red = cv2.imread(str(folder / "a_2.png"))[TOP + 4, MOVED[2] + 4].tolist()
    assert (red, green, blue) == pytest.approx((255, 0, 128), abs=2)
    photo, shown = (cv2.imread(str(place)) for place in (walked.folder / "a" / "2.jpg", folder / "a_2.png"))
    np.testing.assert_allclose(shown[:, -8:], photo[:, -8:], atol=2)


@pytest.mark.parametrize(
    ("share", "photos", "ignored", "words"),
    [
        (0.16123, 67, True, "16.1 % of the pixels, in 67 photos, look as if something moved there; they are ignored"),
        (0.06, 9, True, "6.0 % of the pixels, in 9 photos"),
        (0.0394, 36, False, "too few to tell from places that are hard to draw, so they are used"),
        (0.0, 0, False, None),
    ],
)
def test_few_transients_are_told_and_not_ignored(share: float, photos: int, ignored: bool, words: str | None) -> None:
    found = Transients(masks=Path("masks"), share=share, photos=photos, seconds=1.0)
    assert found.ignored == ignored
    assert len(found.notes) == (words is not None)
    assert not found.notes or str(words) in found.notes[0]


def test_finished_search_is_repeated_for_other_settings_alone(walked: Posed, tmp_path: Path) -> None:
    fits, settings = Fits(), dataclasses.replace(preset("draft"), steps=8)
    first = find_transients(walked, tmp_path / "out", settings, "one", fits, silent)
    assert [steps for *_, steps, _ in fits.asked] == [2] * 4 + [4] * 4
    again = find_transients(walked, tmp_path / "out", settings, "one", fits, silent)
    assert (again, len(fits.asked)) == (first, 8)
    find_transients(walked, tmp_path / "out", settings, "two", fits, silent)
    assert len(fits.asked) == 16


def test_interrupted_search_of_other_photos_leaves_nothing_behind(walked: Posed, tmp_path: Path) -> None:
    out, fits = tmp_path / "out", Fits()
    find_transients(walked, out, preset("draft"), "first", fits, silent)
    shown: list[bytes] = []

    def stop(posed: Posed, *_: object) -> Gaussians:
        shown.append((posed.folder / "a" / "1.jpg.png").read_bytes())
        raise KeyboardInterrupt

    for identity in ("second", "second"):
        with pytest.raises(KeyboardInterrupt):
            find_transients(walked, out, preset("draft"), identity, stop, silent)
    assert sorted(path.name for path in (out / "transients").iterdir()) == ["masks", "work_second"]
    write_png(walked.folder / "a" / "1.jpg", np.zeros((*SIZE_PX, 3), np.uint8))
    with pytest.raises(KeyboardInterrupt):
        find_transients(walked, out, preset("draft"), "third", stop, silent)
    assert shown[0] == shown[1] != shown[2]
    assert sorted(path.name for path in (out / "transients").iterdir()) == ["masks", "work_third"]
    find_transients(walked, out, preset("draft"), "first", fits, silent)
    assert len(fits.asked) == 16, "masks may be those of another search"


@pytest.mark.parametrize("times", [1, 2])
def test_photos_of_mostly_what_moves_are_refused_also_by_an_earlier_search(
    walked: Posed, tmp_path: Path, times: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    fits = Fits()
    find_transients(walked, tmp_path / "out", preset("draft"), "one", fits, silent)
    monkeypatch.setattr(transients, "SHARE_MAX", 0.001)
    for _ in range(times):
        with pytest.raises(
            RunError, match=r"% of the pixels look as if something moved there: too little of the place"
        ):
            find_transients(walked, tmp_path / "out", preset("draft"), "two" if times == 2 else "one", fits, silent)
    assert len(fits.asked) == 8 * times


def test_nothing_that_moves_is_nothing_to_note(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.services.reconstructor.training.test_transients.MOVED", {})
    posed = write_photos(tmp_path / "photos", VIEWS)
    found = find_transients(posed, tmp_path / "out", preset("draft"), "one", Fits(), silent)
    assert found is not None
    assert (found.share, found.photos, found.notes) == (0.0, 0, [])


def test_few_photos_tell_nothing(tmp_path: Path) -> None:
    posed = write_photos(tmp_path / "photos", 7)
    assert find_transients(posed, tmp_path / "out", preset("draft"), "one", Fits(), silent) is None
    twice = posed.select([*range(7), *range(7)])
    assert find_transients(twice, tmp_path / "out", preset("draft"), "one", Fits(), silent) is None
    assert not (tmp_path / "out").exists()


Write = Callable[[Path], Path]


@pytest.mark.usefixtures("few_steps")
def test_training_ignores_what_moved_unless_masks_are_given(
    write_posed: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transients, "_PHOTOS_MIN", 6)
    # Predictions after so few steps differ everywhere, and are as wrong in other photos.
    monkeypatch.setattr(transients, "SHARE_MAX", 1.0)
    monkeypatch.setattr(transients, "_STRONG", 0.1)
    monkeypatch.setattr(transients, "_WEAK", 0.05)
    settings = GaussiansConfig(steps=12, hold_out=5, sh_degree=1, transients=True, density=DensityConfig(count_max=200))
    posed = write_posed(tmp_path / "posed")
    searched: list[bool] = []
    report = train_gaussians(posed, tmp_path / "out", settings, lambda at: searched.append(at.searches))
    assert report["transients"]["ignored"]
    assert 0.06 <= report["transients"]["share"] <= 1.0
    assert report["seconds"]["transients"] > 0
    assert "previews/transients" in report["notes"][-1]
    assert len(list((tmp_path / "out" / "transients" / "masks").iterdir())) == 6
    assert searched[0]
    assert not searched[-1]
    off = train_gaussians(posed, tmp_path / "off", dataclasses.replace(settings, transients=False), silent)
    assert off["transients"] is None
    assert "transients" not in off["seconds"]
    monkeypatch.setattr(transients, "_SHARE_MIN", 1.1)
    few = train_gaussians(posed, tmp_path / "few", settings, silent)
    assert few["transients"] == {**report["transients"], "ignored": False}
    assert (few["psnr_db"], "are used" in few["notes"][-1]) == (off["psnr_db"], True)
    assert not (tmp_path / "off" / "transients").exists()
    for number in range(6):
        write_png(posed / "masks" / f"{number}.png.png", np.full((*SIZE_PX, 3), 255, np.uint8))
    given = train_gaussians(posed, tmp_path / "given", settings, silent)
    assert given["transients"] is None
    assert given["psnr_db"] == off["psnr_db"]
