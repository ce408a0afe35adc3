"""Which body a fit begins with: that with which a short fit comes nearest to the person.

What no image shows, such as joints that do not bend in the film, stays as it is on the body. Silhouettes in noisy poses
hardly tell one body from another; after a short fit of small images, poses and lengths are the person's, and what is
left tells how alike the bodies are. All begin in one grey: clothes say nothing of a body.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from readygo.common.avatars import Avatar
from readygo.services.reconstructor.avatars.body import OVERLAP_MIN, sized_body
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.fit import PersonFit
from readygo.services.reconstructor.avatars.footage import Footage
from readygo.services.reconstructor.avatars.trajectory import PoseTrajectory
from readygo.services.reconstructor.avatars.views import read_person

TRIAL_SHARE = 0.05
"""Steps of a trial, as a share of those of the fit."""
TRIAL_SIDE_PX = 192
"""Longer side of its images [px]."""


def choose_body(
    bodies: Mapping[str, Avatar],
    footage: Footage,
    trajectory: PoseTrajectory,
    config: AvatarFitConfig,
    tell: Callable[[PersonFit], None] = lambda _: None,
) -> tuple[Avatar, float]:
    """The body that suits the person best, at the person's size, and the common share of the silhouettes' union.

    Args:
        bodies: Avatars by name.
        footage: The film.
        trajectory: How the person moved.
        config: How the fit will be.
        tell: Is told of every trial when it is over.
    """
    side_px = min(TRIAL_SIDE_PX, config.side_max_px)
    person, pose, root_m = read_person(footage, side_px), trajectory.pose_axis_angle, trajectory.root_m
    sized = {name: sized_body(bodies[name], person, pose, root_m) for name in sorted(bodies)}
    nearest = max(sized, key=lambda name: sized[name][1])
    if len(sized) == 1 or sized[nearest][1] < OVERLAP_MIN:
        return sized[nearest]
    steps = max(round(TRIAL_SHARE * config.steps), 1)
    trial = replace(config, steps=steps, side_max_px=side_px, representation="direct")
    losses = {}
    for name, (body, _) in sized.items():
        fit = PersonFit(body, person, trajectory, trial)
        losses[name] = _loss_of_trial(fit)
        tell(fit)
    return sized[min(losses, key=lambda name: losses[name])]


def _loss_of_trial(fit: PersonFit) -> float:
    """The mean loss of the last steps of a whole fit that begins in one grey."""
    fit.bound.gaussians.values["sh"][:] = 0.0
    losses = []
    while fit.step < fit.config.steps:
        fit.one_step()
        losses.append(fit.loss)
    return float(np.mean(losses[len(losses) // 2 :]))
