"""The scene is drawn with the person as its plates show it, hides what is behind it, and is learned from the photos."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud
from readygo.services.reconstructor.avatars import surroundings as surroundings_module
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.extract import extract_avatar
from readygo.services.reconstructor.avatars.fit import PersonFit
from readygo.services.reconstructor.avatars.footage import SMPL_PELVIS_M, read_footage
from readygo.services.reconstructor.avatars.hugs import HugsFit
from readygo.services.reconstructor.avatars.plates import with_plates
from readygo.services.reconstructor.avatars.surroundings import Surroundings
from readygo.services.reconstructor.avatars.views import FilmedPerson, view_at
from readygo.services.reconstructor.differentiable.autograd import rasterize
from tests.services.reconstructor.avatars.conftest import trajectory_of

CONFIG = AvatarFitConfig(steps=40, hold_out=4, gaussians_max=2000)
FRAME = 2


def _around(clouds: list[GaussianCloud], person: FilmedPerson, film: Path) -> Surroundings:
    return Surroundings(clouds, person, read_footage(film).root_m, CONFIG.steps)


def _draw(around: Surroundings, person: FilmedPerson, frame: int) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    """The surroundings of a frame alone, shape (3, H, W), and what they are drawn from."""
    leaves = {name: torch.from_numpy(array).requires_grad_() for name, array in around.arrays(frame).items()}
    height, width = person.mask[frame].shape
    rendered = rasterize(
        **leaves,
        T_world_camera=torch.from_numpy(person.T_world_camera[frame]),
        K_px=person.K_px[frame],
        height_px=height,
        width_px=width,
        sh_degree=0,
    )
    assert rendered.rgb is not None
    background = torch.from_numpy(around.background(frame))
    return rendered.rgb.permute(2, 0, 1) + rendered.transmittance * background, leaves


def test_alone_it_looks_as_its_plates(filmed: FilmedPerson, plain_film: Path, wall: GaussianCloud) -> None:
    person = with_plates(filmed, [wall])
    around = _around([wall], person, plain_film)
    assert 100 < len(around) < len(wall)
    assert person.plates is not None
    for frame in (0, 7):
        drawn, _ = _draw(around, person, frame)
        plate = person.plates[frame].transpose(2, 0, 1) / 255.0
        # Blobs of the wall are equally far: some change their order.
        np.testing.assert_allclose(drawn.detach().numpy(), plate, atol=0.03)
        assert np.abs(drawn.detach().numpy() - plate).mean() < 0.002


def test_colours_of_higher_degree_depend_on_the_camera(
    filmed: FilmedPerson, plain_film: Path, wall: GaussianCloud
) -> None:
    rng = np.random.default_rng(1)
    shiny = replace(
        wall, sh=np.concatenate([wall.sh, rng.normal(0.0, 0.1, (len(wall), 3, 3))], axis=1, dtype=np.float32)
    )
    person = with_plates(filmed, [shiny])
    drawn, _ = _draw(_around([shiny], person, plain_film), person, FRAME)
    assert person.plates is not None
    np.testing.assert_allclose(drawn.detach().numpy(), person.plates[FRAME].transpose(2, 0, 1) / 255.0, atol=0.012)


def test_steps_follow_the_derivatives_of_images(
    filmed: FilmedPerson, plain_film: Path, wall: GaussianCloud, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Derivatives by what is learned are those of finite differences, with the pull towards where it began."""
    person = with_plates(filmed, [wall])
    around = _around([wall], person, plain_film)
    values = around.gaussians.values
    values["sh"] += np.random.default_rng(0).uniform(0.0, 0.05, values["sh"].shape).astype(np.float32)
    seen: dict[str, np.ndarray] = {}

    def keep(_gaussians: object, slopes: list[dict[str, np.ndarray]], *_: object) -> None:
        seen.update(slopes[0])

    monkeypatch.setattr(around._adam, "step", keep)
    weights = torch.from_numpy(np.random.default_rng(1).uniform(0.5, 1.0, (3, *person.mask[FRAME].shape)).astype("f4"))

    def loss() -> float:
        image = float((weights.double() * _draw(around, person, FRAME)[0].detach().double()).sum())
        moved = values["logits"] - around._logits
        return image + float(
            surroundings_module._COLOUR_PULL * np.square(values["sh"]).sum()
            + surroundings_module._OPACITY_PULL * np.square(moved).sum()
        )

    image, leaves = _draw(around, person, FRAME)
    (weights * image).sum().backward()  # type: ignore[no-untyped-call]
    by_opacities, by_sh = leaves["opacities"].grad, leaves["sh"].grad
    assert by_opacities is not None
    assert by_sh is not None
    rows = np.argsort(-by_sh.abs().sum(dim=(1, 2)).numpy())[:5]
    around.step(FRAME, rows, by_opacities.numpy()[rows], by_sh.numpy()[rows, 0])
    for place, row in enumerate(around._frames[FRAME].rows[rows]):
        for name, size in (("sh", 0.02), ("logits", 0.05)):
            before = values[name][row, 0]
            sides = []
            for sign in (1.0, -1.0):
                values[name][row, 0] = before + sign * size
                sides.append(loss())
            values[name][row, 0] = before
            expected = (sides[0] - sides[1]) / (2.0 * size)
            assert seen[name][place, 0] == pytest.approx(expected, rel=0.05, abs=0.02)


def test_what_is_clearly_before_the_person_hides_it(
    filmed: FilmedPerson, plain_film: Path, coarse_body: Avatar, wall: GaussianCloud
) -> None:
    """The wall behind hides nothing, one 0.3 m before the pelvis neither (as a floor), one halfway everything."""
    footage = read_footage(plain_film)
    person = with_plates(filmed, [wall])
    pelvis_m, camera_m = float(footage.root_m[0, 1]), float(person.T_world_camera[0, 1, 3])
    hidden = []
    for y_m in (2.5, pelvis_m - 0.3, 0.5 * (pelvis_m + camera_m)):
        cloud = replace(wall, means_m=wall.means_m + np.float32([0.0, y_m - 2.5, 0.0]))
        around = _around([cloud], person, plain_film)
        fit = PersonFit(coarse_body, person, trajectory_of(footage), CONFIG, surroundings=around)
        drawn = fit.draw(0, view_at(person, 0, 1)).rendered
        assert drawn.features is not None
        hidden.append(1.0 - float(drawn.features[..., 0].numpy()[person.mask[0]].mean()))
    assert hidden[1] == pytest.approx(hidden[0], abs=1e-3)
    assert hidden[0] < 0.3
    assert hidden[2] > 0.9


def test_scene_in_other_colours_is_learned_and_comes_back(
    filmed: FilmedPerson, plain_film: Path, coarse_body: Avatar, wall: GaussianCloud
) -> None:
    """Blobs whose colours are wrong get those of the photos; held-out frames change nothing; the state is whole."""
    wrong = replace(wall, sh=(wall.sh + np.random.default_rng(2).normal(0.0, 0.3, wall.sh.shape)).astype(np.float32))
    person = with_plates(filmed, [wrong])

    def begin() -> PersonFit:
        around = _around([wrong], person, plain_film)
        return PersonFit(coarse_body, person, trajectory_of(read_footage(plain_film)), CONFIG, surroundings=around)

    def beside(fit: PersonFit) -> float:
        """Mean difference from the photo where no person is."""
        assert fit.surroundings is not None
        photo, mask = person.rgb[FRAME].transpose(2, 0, 1) / 255.0, person.mask[FRAME]
        return float(np.abs(_draw(fit.surroundings, person, FRAME)[0].detach().numpy() - photo)[:, ~mask].mean())

    fit, state = begin(), {}
    before = beside(fit)
    while fit.step < CONFIG.steps:
        if fit.step == 21:
            state = {name: array.copy() for name, array in fit.state().items()}
        assert fit.surroundings is not None
        colours = fit.surroundings.gaussians.values["sh"].copy()
        held = fit._next_view(fit.step / CONFIG.steps)[0] in fit.held
        fit.one_step()
        assert np.array_equal(colours, fit.surroundings.gaussians.values["sh"]) == held
    assert beside(fit) < 0.85 * before
    resumed = begin()
    resumed.load(21, state)
    while resumed.step < CONFIG.steps:
        resumed.one_step()
    for name, array in fit.state().items():
        np.testing.assert_array_equal(array, resumed.state()[name], err_msg=name)


def test_planes_and_decoders_learn_the_scene_as_well(
    filmed: FilmedPerson, plain_film: Path, coarse_body: Avatar, wall: GaussianCloud
) -> None:
    config = AvatarFitConfig(representation="hugs", hugs_points=600, steps=20, hold_out=6)
    person = with_plates(filmed, [wall])
    around = _around([wall], person, plain_film)
    fit = HugsFit(
        coarse_body,
        person,
        trajectory_of(read_footage(plain_film)),
        config,
        pelvis_m=SMPL_PELVIS_M,
        fixed_lengths=False,
        surroundings=around,
    )
    for _ in range(8):
        fit.one_step()
    assert around.gaussians.values["sh"].any()
    assert "scene_value_sh" in fit.state()
    other = _around([wall], person, plain_film)
    other.load(fit.state())
    np.testing.assert_array_equal(other.gaussians.values["sh"], around.gaussians.values["sh"])


def test_extraction_learns_the_scene_unless_told_not_to(
    plain_film: Path, coarse_body: Avatar, wall: GaussianCloud, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("readygo.services.reconstructor.avatars.plates.PLATE_SHARE_MIN", -100.0)
    steps = 0

    class Counted(Surroundings):
        def step(self, *arrays: "object") -> None:
            nonlocal steps
            steps += 1
            super().step(*arrays)  # type: ignore[arg-type]

    monkeypatch.setattr("readygo.services.reconstructor.avatars.extract.Surroundings", Counted)
    for joint in (False, True):
        config = AvatarFitConfig(steps=12, hold_out=6, gaussians_max=2000, joint_scene=joint)
        work = tmp_path / f"work_{joint}"
        extract_avatar(
            plain_film, work, config, lambda _: None, name="a", license_text="b",
            bodies={coarse_body.name: coarse_body}, scene=[wall],
        )  # fmt: skip
        assert (steps > 0) == joint
