"""A fit makes the drawn person more like the filmed one, and repeats itself from a checkpoint."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from readygo.common.avatars import Avatar
from readygo.services.reconstructor.avatars import fit as fit_module
from readygo.services.reconstructor.avatars.config import AvatarFitConfig, PosePriorConfig
from readygo.services.reconstructor.avatars.fit import PersonFit, fraction_at, needle_loss
from readygo.services.reconstructor.avatars.footage import read_footage
from readygo.services.reconstructor.avatars.views import read_person
from tests.services.reconstructor.avatars.conftest import trajectory_of

CONFIG = AvatarFitConfig(steps=60, hold_out=4, gaussians_max=2000)
NO_MASKS = replace(CONFIG, mask_weight=0.0)


def _fit(film: Path, body: Avatar) -> PersonFit:
    footage = read_footage(film)
    return PersonFit(body, read_person(footage, 96), trajectory_of(footage), CONFIG)


def test_loss_falls_and_resuming_changes_nothing(
    plain_film: Path, coarse_body: Avatar, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fit_module, "_CHANGE_EVERY", 10)
    whole, losses = _fit(plain_film, coarse_body), []
    state = {}
    for step in range(CONFIG.steps):
        if step == 31:
            state = {name: array.copy() for name, array in whole.state().items()}
        whole.one_step()
        losses.append(whole.loss)
    assert np.mean(losses[-12:]) < 0.8 * np.mean(losses[:12])
    resumed = _fit(plain_film, coarse_body)
    resumed.load(31, state)
    while resumed.step < CONFIG.steps:
        resumed.one_step()
    for name, array in whole.state().items():
        np.testing.assert_array_equal(array, resumed.state()[name], err_msg=name)
    assert whole.seen().mean() > 0.3


def test_held_out_frames_change_poses_alone(plain_film: Path, coarse_body: Avatar) -> None:
    fit = _fit(plain_film, coarse_body)
    assert fit.held == (0, 4, 8)
    before = {name: array.copy() for name, array in fit.state().items()}
    for _ in range(12):
        frame = fit._next_view(fit.step / CONFIG.steps)[0]
        changed = {name for name, array in fit.state().items() if not np.array_equal(array, before[name])}
        lengths = fit.rig.values["bones"].copy()
        poses = fit.rig.values["pose"].copy()
        colours = fit.bound.gaussians.values["sh"].copy()
        fit.one_step()
        assert not np.array_equal(fit.rig.values["pose"], poses)
        same = np.array_equal(fit.bound.gaussians.values["sh"], colours)
        assert same == (frame in fit.held)
        assert np.array_equal(fit.rig.values["bones"], lengths) == (frame in fit.held)
    assert changed


def test_joints_leave_their_bones_if_asked(plain_film: Path, coarse_body: Avatar) -> None:
    for offsets in (False, True):
        footage = read_footage(plain_film)
        config = replace(CONFIG, offsets=offsets)
        fit = PersonFit(coarse_body, read_person(footage, 96), trajectory_of(footage), config)
        for _ in range(3):
            fit.one_step()
        assert bool(fit.rig.values["offsets"].any()) == offsets


def test_before_plates_whole_photos_are_compared(plain_film: Path, coarse_body: Avatar) -> None:
    """Where photos are their plates and masks are wrong, no one is found; by masks alone, someone is."""
    footage = read_footage(plain_film)
    person, opacities = read_person(footage, 96), {}
    for plates in (None, person.rgb):
        fit = PersonFit(coarse_body, replace(person, plates=plates), trajectory_of(footage), NO_MASKS)
        before = fit.bound.gaussians.opacities.mean()
        for _ in range(CONFIG.steps):
            fit.one_step()
        opacities[plates is None] = fit.bound.gaussians.opacities.mean() / before
    assert opacities[False] < 0.96
    assert opacities[True] > 1.0


def test_soles_stand_where_frames_are_in_order(plain_film: Path, coarse_body: Avatar) -> None:
    footage = read_footage(plain_film)
    person, weights = read_person(footage, 96), []
    for prior in (PosePriorConfig(contacts=0.5), PosePriorConfig(contacts=0.5, in_order=False)):
        fit = PersonFit(coarse_body, person, trajectory_of(footage), replace(CONFIG, prior=prior))
        weights.append(fit.rig._contact_weight)
        assert fit.rig._contacts_every == CONFIG.steps // 10
    assert weights == [0.5, 0.0]


def test_needles_become_rounder_if_asked(plain_film: Path, coarse_body: Avatar) -> None:
    stretch = {}
    for weight in (0.0, 1e-3):
        footage = read_footage(plain_film)
        config = replace(CONFIG, isotropy=weight)
        fit = PersonFit(coarse_body, read_person(footage, 96), trajectory_of(footage), config)
        for _ in range(CONFIG.steps):
            fit.one_step()
        axes = np.sort(fit.bound.gaussians.values["log_scales"], axis=1)
        stretch[weight] = float(np.mean(axes[:, 2] - axes[:, 1]))
    assert stretch[1e-3] < 0.8 * stretch[0.0]


def test_derivatives_of_needles_are_those_of_finite_differences() -> None:
    shapes = torch.tensor(np.random.default_rng(0).normal(-5.0, 1.0, (4, 3)), requires_grad=True)
    assert torch.autograd.gradcheck(needle_loss, [shapes])
    assert float(needle_loss(torch.tensor([[0.0, -9.0, np.log(2.0)]]))) == pytest.approx(np.log(2.0) ** 2)


def test_images_grow() -> None:
    assert fraction_at(0.0) == 2
    assert fraction_at(0.99) == 1
