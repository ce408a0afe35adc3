"""HUGS checkpoints: baked humans are posed as HUGS poses them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.arrays import Float64Array
from readygo.common.avatars import SMPL_PARENTS, pose_avatar
from readygo.common.avatars.importers import ImportOptions, import_human, load_smpl_model
from readygo.common.avatars.importers.hugs import da_pose, load_checkpoint
from readygo.common.avatars.importers.joints import JOINT
from readygo.common.errors import AvatarError
from readygo.common.frames import matrix_from_axis_angle, matrix_from_quat, zup_from_yup
from tests.common.avatars.importers.humans import boxes, write_smpl_pickle

torch = pytest.importorskip("torch", reason="torch is not installed")
functional = torch.nn.functional

COUNT, FEATURES, SIZE, HIDDEN = 300, 4, 16, 12


def _linear(rng: np.random.Generator, outputs: int, inputs: int) -> dict[str, Any]:
    return {
        "weight": torch.tensor(rng.normal(0, 0.3, (outputs, inputs)), dtype=torch.float32),
        "bias": torch.tensor(rng.normal(0, 0.3, outputs), dtype=torch.float32),
    }


def _decoder(rng: np.random.Generator, heads: dict[str, int], hidden: int) -> dict[str, Any]:
    layers = {"net.0": _linear(rng, hidden, 3 * FEATURES), "net.2": _linear(rng, hidden, hidden)}
    layers |= {name: _linear(rng, outputs, hidden) for name, outputs in heads.items()}
    return {f"{name}.{kind}": value for name, layer in layers.items() for kind, value in layer.items()}


def _checkpoint(model_joints: Float64Array) -> dict[str, Any]:
    """The released layout: random decoders, points on the body in the da-pose."""
    rng = np.random.default_rng(7)
    vertices, _, owners, _ = boxes()
    chosen = rng.choice(len(vertices), COUNT)
    G, P = da_pose(model_joints)
    points = (
        np.einsum("nij,nj->ni", G[owners[chosen]], vertices[chosen] - model_joints[owners[chosen]]) + P[owners[chosen]]
    )
    state = {
        "active_sh_degree": 0,
        # Feature planes reach from -1 to 1 m, so that the body has to lie about the origin.
        "xyz": torch.nn.Parameter(torch.tensor(points - [0, 0.95, 0], dtype=torch.float32)),
        "scaling_multiplier": torch.full((COUNT, 1), 0.05),
        "max_radii2D": torch.zeros(COUNT),
        "xyz_gradient_accum": torch.zeros(COUNT, 1),
        "denom": torch.zeros(COUNT, 1),
        "optimizer": {"state": {}, "param_groups": [{"lr": 1e-3, "name": "xyz", "params": [0]}]},
        "spatial_lr_scale": 1.0,
        "triplane": {
            plane: torch.tensor(rng.normal(0, 0.5, (1, FEATURES, SIZE, SIZE)), dtype=torch.float32)
            for plane in ("plane_xy", "plane_xz", "plane_yz")
        },
        "appearance_dec": _decoder(rng, {"opacity.0": 1, "shs": 48}, HIDDEN),
        "geometry_dec": _decoder(rng, {"xyz.1": 3, "rotations.1": 6, "scales.1": 3}, HIDDEN),
        "deformation_dec": _decoder(rng, {"skinning": 24}, HIDDEN),
    }
    state["geometry_dec"]["xyz.1.weight"] *= 0.01
    state["geometry_dec"]["xyz.1.bias"] *= 0.01
    deformation = state["deformation_dec"]
    deformation["skinning_linear.bias"] = torch.tensor(rng.normal(0, 0.3, HIDDEN), dtype=torch.float32)
    deformation["skinning_linear.weight_v"] = torch.tensor(rng.normal(0, 1, (HIDDEN, HIDDEN)), dtype=torch.float32)
    deformation["skinning_linear.weight_g"] = torch.tensor(rng.uniform(0.5, 1, (HIDDEN, 1)), dtype=torch.float32)
    # Only four joints stand out, so that nothing is lost when the four strongest are kept.
    bias = torch.full((24,), -6.0)
    bias[[0, 1, 9, 16]] = 2.0
    deformation["skinning.bias"] = bias
    return state


def _forward(state: dict[str, Any]) -> dict[str, Float64Array]:
    """The decoders as torch modules, a second way to the same numbers."""

    def network(decoder: dict[str, Any]) -> Any:
        net = torch.nn.Sequential(
            torch.nn.Linear(3 * FEATURES, HIDDEN), torch.nn.GELU(), torch.nn.Linear(HIDDEN, HIDDEN), torch.nn.GELU()
        )
        net.load_state_dict({key.removeprefix("net."): v for key, v in decoder.items() if key.startswith("net.")})
        return net

    def head(decoder: dict[str, Any], name: str, x: Any) -> Any:
        return functional.linear(x, decoder[f"{name}.weight"], decoder[f"{name}.bias"])

    xyz = state["xyz"].detach()
    planes = [state["triplane"][f"plane_{axes}"] for axes in ("xy", "xz", "yz")]
    features = torch.cat(
        [
            functional.grid_sample(plane, xyz[None, :, None, axes], align_corners=True)[0, :, :, 0].T
            for plane, axes in zip(planes, ([0, 1], [0, 2], [1, 2]), strict=True)
        ],
        dim=1,
    )
    appearance, geometry, deformation = (state[f"{name}_dec"] for name in ("appearance", "geometry", "deformation"))
    with torch.no_grad():
        a, g, d = (network(decoder)(features) for decoder in (appearance, geometry, deformation))
        weight = torch._weight_norm(deformation["skinning_linear.weight_v"], deformation["skinning_linear.weight_g"], 0)
        d = functional.gelu(functional.linear(d, weight, deformation["skinning_linear.bias"]))
        out = {
            "means": xyz + head(geometry, "xyz.1", g),
            "scales": functional.gelu(head(geometry, "scales.1", g)) * state["scaling_multiplier"],
            "sixes": head(geometry, "rotations.1", g),
            "opacities": torch.sigmoid(head(appearance, "opacity.0", a))[:, 0],
            "sh": head(appearance, "shs", a).reshape(-1, 16, 3)[:, :1],
            "weights": torch.softmax(functional.gelu(head(deformation, "skinning", d)) / 0.1, dim=1),
        }
    return {key: value.numpy().astype(np.float64) for key, value in out.items()}


def _smpl_matrices(joints: Float64Array, pose: Float64Array) -> Float64Array:
    """SMPL's joint transforms with the rest pose removed, shape (24, 4, 4)."""
    R = matrix_from_axis_angle(pose)
    chain: list[Float64Array] = []
    for joint in range(24):
        parent = int(SMPL_PARENTS[joint])
        T = np.eye(4)
        T[:3, :3] = R[joint]
        T[:3, 3] = joints[joint] - (joints[parent] if parent >= 0 else 0)
        chain.append(chain[parent] @ T if parent >= 0 else T)
    A = np.array(chain)
    A[:, :3, 3] -= np.einsum("jik,jk->ji", A[:, :3, :3], joints)
    return A


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("hugs")
    smpl = write_smpl_pickle(folder / "SMPL_NEUTRAL.pkl")
    state = _checkpoint(load_smpl_model(smpl).joints_m)
    torch.save(state, folder / "human_final.pth")
    return folder / "human_final.pth", smpl


def test_baked_human_is_posed_as_hugs_poses_the_checkpoint(files: tuple[Path, Path]) -> None:
    checkpoint, smpl = files
    state = torch.load(checkpoint, weights_only=True)
    avatar, report = import_human(checkpoint, ImportOptions(license="test", smpl=smpl, height_m=1.75))
    want = _forward(state)
    joints = load_smpl_model(smpl).joints_m
    rng = np.random.default_rng(1)
    pose = rng.normal(0, 0.3, (24, 3))
    vitruvian = np.zeros((24, 3))
    vitruvian[JOINT["left_hip"], 2], vitruvian[JOINT["right_hip"], 2] = 1.0, -1.0
    A = _smpl_matrices(joints, pose) @ np.linalg.inv(_smpl_matrices(joints, vitruvian))
    T = np.einsum("nj,jik->nik", want["weights"], A)
    posed = np.einsum("nik,nk->ni", T[:, :3, :3], want["means"]) + T[:, :3, 3]
    # Ours has the pelvis at a given place of the z-up world and another size.
    scale = np.linalg.norm(avatar.joints_tpose_m[4] - avatar.joints_tpose_m[1]) / np.linalg.norm(joints[4] - joints[1])
    got = pose_avatar(avatar, (0.0, 0.0, 0.0), pose)
    np.testing.assert_allclose(got.means_m, zup_from_yup(posed - joints[0]) * scale, atol=2e-5)
    np.testing.assert_allclose(got.scales_m, np.maximum(np.abs(want["scales"]), 1e-4) * scale, rtol=1e-4)
    np.testing.assert_allclose(got.opacities, want["opacities"], atol=1e-6)
    np.testing.assert_allclose(got.sh, want["sh"], atol=1e-5)
    assert report.kind == "HUGS checkpoint"
    assert any("shape" in note for note in report.notes)


def test_rotations_are_two_rows_made_orthonormal(files: tuple[Path, Path]) -> None:
    checkpoint, smpl = files
    sixes = _forward(torch.load(checkpoint, weights_only=True))["sixes"]
    avatar, _ = import_human(checkpoint, ImportOptions(license="test", smpl=smpl, height_m=1.75))
    R = matrix_from_quat(avatar.cloud.quats_wxyz)
    first = sixes[:, :3] / np.linalg.norm(sixes[:, :3], axis=1, keepdims=True)
    np.testing.assert_allclose(R[:, 0], first, atol=1e-5)
    np.testing.assert_allclose((R[:, 1] * sixes[:, :3]).sum(axis=1), 0.0, atol=1e-5)
    assert ((R[:, 1] * sixes[:, 3:]).sum(axis=1) > 0).all()


def test_canonical_pose_is_the_da_pose_with_ankles_at_standing_height(files: tuple[Path, Path]) -> None:
    checkpoint, smpl = files
    avatar, _ = import_human(checkpoint, ImportOptions(license="test", smpl=smpl, height_m=1.75))
    ankles = [JOINT["left_ankle"], JOINT["right_ankle"]]
    assert avatar.joints_canonical_m[ankles, 1].mean() == pytest.approx(
        avatar.joints_tpose_m[ankles, 1].mean(), abs=1e-5
    )
    thigh = avatar.joints_canonical_m[JOINT["left_knee"]] - avatar.joints_canonical_m[JOINT["left_hip"]]
    straight = avatar.joints_tpose_m[JOINT["left_knee"]] - avatar.joints_tpose_m[JOINT["left_hip"]]
    angle = np.arccos(thigh @ straight / np.linalg.norm(thigh) / np.linalg.norm(straight))
    assert angle == pytest.approx(1.0, abs=1e-4)


def test_smpl_model_is_asked_for(files: tuple[Path, Path]) -> None:
    with pytest.raises(AvatarError, match="--smpl"):
        import_human(files[0], ImportOptions(license="test"))


def test_betas_of_neuman_files_shape_the_joints(files: tuple[Path, Path], tmp_path: Path) -> None:
    np.savez(tmp_path / "betas.npz", betas=np.tile([0.5, 0.0], (4, 1)))
    options = {"license": "test", "smpl": files[1], "height_m": 1.75}
    mean, _ = import_human(files[0], ImportOptions(**options))  # type: ignore[arg-type]
    shaped, report = import_human(files[0], ImportOptions(**options, betas=tmp_path / "betas.npz"))  # type: ignore[arg-type]
    assert np.abs(mean.joints_tpose_m - shaped.joints_tpose_m).max() > 0.005
    assert not any("mean shape" in note for note in report.notes)


def _saved(path: Path, files: tuple[Path, Path], change: Any) -> Path:
    state = torch.load(files[0], weights_only=True)
    change(state)
    torch.save(state, path)
    return path


@pytest.mark.parametrize(
    ("change", "coefficients"),
    [(lambda s: s.pop("active_sh_degree"), 1), (lambda s: s.update(active_sh_degree=1), 4)],
)
def test_colours_have_the_checkpoints_degree_and_none_by_direction_if_it_names_none(
    files: Any, tmp_path: Path, change: Any, coefficients: int
) -> None:
    path = _saved(tmp_path / "x.pth", files, change)
    avatar, _ = import_human(path, ImportOptions(license="test", smpl=files[1], height_m=1.75))
    assert avatar.cloud.sh.shape[1:] == (coefficients, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.pop("triplane"), "lacks triplane"),
        (lambda s: s["geometry_dec"].pop("scales.1.bias"), r"lacks geometry_dec\.scales\.1\.bias"),
        (lambda s: s["deformation_dec"].pop("skinning_linear.weight_g"), r"skinning_linear\.weight_g"),
        (
            lambda s: s["appearance_dec"].update({"shs.weight": torch.zeros(5, HIDDEN)}),
            r"shs\.weight.* must be 48 x 12",
        ),
        (lambda s: s.update(xyz=torch.full((COUNT, 3), float("nan"))), "xyz of the checkpoint holds values"),
        (lambda s: s.update(xyz=s["xyz"] * 5), r"must lie in -1\.\.1"),
        (
            lambda s: s.update(scaling_multiplier=torch.ones(3, 1)),
            "scaling_multiplier of the checkpoint must be 300 x 1",
        ),
        (lambda s: s.update(xyz="text"), "must be a tensor"),
        (lambda s: s.update(triplane=torch.zeros(3)), "triplane of the checkpoint must be a dictionary"),
        (lambda s: s["triplane"].update(plane_xy=torch.zeros(1, 4, 0, 0)), r"triplane\.plane_xy .* is empty"),
        (lambda s: s.update(geometry_dec=[1.0]), "geometry_dec of the checkpoint must be a dictionary"),
        (lambda s: s.update(active_sh_degree="x"), "active_sh_degree of the checkpoint must be a whole number"),
        (lambda s: s.update(active_sh_degree=torch.zeros(2)), "active_sh_degree of the checkpoint must be a whole"),
        (lambda s: s.update(active_sh_degree=None), "active_sh_degree of the checkpoint must be a whole number"),
    ],
)
def test_checkpoints_that_lack_something_are_refused(files: Any, tmp_path: Path, change: Any, message: str) -> None:
    path = _saved(tmp_path / "x.pth", files, change)
    with pytest.raises(AvatarError, match=message) as raised:
        import_human(path, ImportOptions(license="test", smpl=files[1], height_m=1.75))
    assert "\n" not in str(raised.value)


class _Foreign:
    pass


def test_checkpoints_with_foreign_objects_are_refused(tmp_path: Path, files: tuple[Path, Path]) -> None:
    torch.save({"xyz": _Foreign()}, tmp_path / "x.pth")
    with pytest.raises(AvatarError, match="not a checkpoint of plain tensors") as raised:
        import_human(tmp_path / "x.pth", ImportOptions(license="test", smpl=files[1]))
    assert "\n" not in str(raised.value)


def test_checkpoint_that_the_system_cannot_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def load(*_: Any, **__: Any) -> None:
        raise OSError(22, "Invalid argument")

    monkeypatch.setattr(torch, "load", load)
    with pytest.raises(AvatarError, match="is not a checkpoint of plain tensors"):
        load_checkpoint(tmp_path / "human.pth")
