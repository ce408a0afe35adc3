import pickle

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from readygo.benchmarks.motion.paths import floor, s_curve
from readygo.common.avatars import SMPL_PARENTS
from readygo.common.errors import ConfigError
from readygo.services.animator import skeleton_of
from readygo.services.animator.gait.quality import joints_of
from readygo.services.animator.smpl import refine as refinement
from readygo.services.animator.smpl.refine import GMOF_SIGMA_M, _Loss, load_pose_prior, refine
from tests.services.animator.smpl.fitted import fit_motion


@pytest.fixture(scope="module")
def noisy(animate, avatar):
    """True joints and noisy ones of two seconds of walking."""
    _, P = joints_of(animate(s_curve(1.2), floor()), avatar)
    P = P[40:80, :22]
    return P, P + np.random.default_rng(1).normal(0.0, 0.01, P.shape)


def error_m(motion, joints, avatar):
    return np.sqrt(np.sum((joints_of(motion, avatar)[1][:, :22] - joints) ** 2, axis=2)).mean()


def weigh(monkeypatch, **weights):
    for name, weight in weights.items():
        monkeypatch.setattr(refinement, f"{name.upper()}_WEIGHT", weight)


def mixture(rng, count=2):
    return {
        "means": rng.standard_normal((count, 69)) * 0.1,
        "covars": np.tile(np.eye(69) * 0.2, (count, 1, 1)),
        "weights": np.full(count, 1.0 / count),
    }


def test_refinement_of_noisy_joints_comes_closer_to_the_truth(noisy, avatar):
    truth, joints = noisy
    offsets = skeleton_of(avatar).offsets_m
    start = fit_motion(joints, offsets)
    refined = refine(start, joints, offsets, iterations=30)
    assert error_m(refined, truth, avatar) < 0.8 * error_m(start, truth, avatar)
    assert refined.root_m.shape == start.root_m.shape


def test_root_stays(noisy, avatar):
    _, joints = noisy
    offsets = skeleton_of(avatar).offsets_m
    start = fit_motion(joints, offsets)
    refined = refine(start, joints, offsets, iterations=3)
    assert np.array_equal(refined.root_m, start.root_m)


def test_knees_that_bend_backwards_are_straightened(noisy, avatar, monkeypatch):
    weigh(monkeypatch, joints=0.0)
    truth, _ = noisy
    offsets = skeleton_of(avatar).offsets_m
    start = fit_motion(truth, offsets)
    pose = start.pose_axis_angle.copy()
    pose[:, 4:6, 0] = -0.4
    bent = type(start)(root_m=start.root_m, pose_axis_angle=pose)
    refined = refine(bent, truth, offsets, iterations=20)
    assert refined.pose_axis_angle[:, 4:6, 0].min() > -0.2


@pytest.mark.parametrize("kind", ["npz", "pkl"])
def test_prior_of_the_user_draws_poses_to_its_means(tmp_path, noisy, avatar, kind, monkeypatch):
    data = mixture(np.random.default_rng(0), 1)
    path = tmp_path / f"gmm_08.{kind}"
    if kind == "npz":
        np.savez(path, **data)
    else:
        path.write_bytes(pickle.dumps(data, protocol=2))
    prior = load_pose_prior(path)
    truth, _ = noisy
    offsets = skeleton_of(avatar).offsets_m
    start = fit_motion(truth, offsets)
    weigh(monkeypatch, joints=0.0, smooth=0.0, limits=0.0, prior=1.0)
    refined = refine(start, truth, offsets, prior, iterations=30)
    assert refined.pose_axis_angle[:, 1:].reshape(-1, 69) == pytest.approx(np.tile(data["means"], (40, 1)), abs=1e-3)


class Harmful:
    def __reduce__(self):
        return print, ("ran",)


def test_pickle_that_would_run_code_is_refused(tmp_path, capsys):
    path = tmp_path / "gmm_08.pkl"
    path.write_bytes(pickle.dumps({"means": Harmful()}))
    with pytest.raises(ConfigError, match=r"names builtins\.print"):
        load_pose_prior(path)
    assert "ran" not in capsys.readouterr().out


@pytest.mark.parametrize("file", [np.zeros(3), {"means": np.array(["x"]), "covars": np.zeros(1)}, [1, 2]])
def test_prior_without_its_arrays_is_refused_in_one_line(tmp_path, file):
    np.savez(tmp_path / "p.npz", **(file if isinstance(file, dict) else {"x": file}))
    (tmp_path / "p.pkl").write_bytes(pickle.dumps(file, protocol=2))
    with (tmp_path / "bare.npz").open("wb") as stream:
        np.save(stream, np.zeros(3))
    for name in ("p.npz", "p.pkl", "bare.npz"):
        with pytest.raises(ConfigError, match=rf"{name} .*give SMPLify's gmm_08\.pkl\.$") as raised:
            load_pose_prior(tmp_path / name)
        assert "\n" not in str(raised.value)


def test_prior_of_another_shape_is_refused(tmp_path):
    np.savez(tmp_path / "p.npz", means=np.zeros((2, 63)), covars=np.zeros((2, 63, 63)), weights=np.ones(2))
    with pytest.raises(ConfigError, match=r"means \(K, 69\).*got \(2, 63\)"):
        load_pose_prior(tmp_path / "p.npz")


def test_joints_of_another_length_are_refused(noisy, avatar):
    truth, _ = noisy
    offsets = skeleton_of(avatar).offsets_m
    with pytest.raises(ValueError, match=r"shape \(40, 22 or 24, 3\)"):
        refine(fit_motion(truth, offsets), truth[:5], offsets)


@pytest.mark.parametrize("with_prior", [False, True])
def test_objective_is_the_sum_of_its_terms(avatar, tmp_path, with_prior, monkeypatch):
    rng, rows = np.random.default_rng(7), 5
    start, pose = rng.normal(0.0, 0.4, (2, rows, 24, 3))
    target, root = rng.normal(0.0, 0.6, (rows, 22, 3)), rng.normal(size=(rows, 3))
    offsets = skeleton_of(avatar).offsets_m
    weigh(monkeypatch, joints=3.1, smooth=0.7, prior=0.013, limits=0.9, start=0.21)
    prior = None
    if with_prior:
        np.savez(
            tmp_path / "prior.npz",
            **mixture(rng),
        )
        prior = load_pose_prior(tmp_path / "prior.npz")
    as_tensors = [torch.from_numpy(array) for array in (target, start, offsets)]
    found = float(_Loss(*as_tensors, prior)(torch.from_numpy(pose), torch.from_numpy(root)))

    local, local_0 = (Rotation.from_rotvec(p.reshape(-1, 3)).as_matrix().reshape(rows, 24, 3, 3) for p in (pose, start))
    G, X = local.copy(), np.empty((rows, 24, 3))
    X[:, 0] = root
    for joint in range(1, 24):
        parent = SMPL_PARENTS[joint]
        G[:, joint] = G[:, parent] @ local[:, joint]
        X[:, joint] = X[:, parent] + G[:, parent] @ offsets[joint]
    squared = ((X[:, :22] - target) ** 2).sum(axis=2)
    total = 3.1 * (squared / (1.0 + squared / GMOF_SIGMA_M**2)).sum()
    total += 0.7 * (np.diff(local, n=2, axis=0) ** 2).sum()
    wrong = np.stack([-pose[:, 4, 0], -pose[:, 5, 0], pose[:, 18, 1], -pose[:, 19, 1]])
    total += 0.9 * (np.maximum(wrong, 0.0) ** 2).sum()
    if prior is None:
        total += 0.21 * ((local - local_0) ** 2).sum()
    else:
        d = pose[:, None, 1:].reshape(rows, 1, 69) - prior.means
        total += 0.013 * (0.5 * np.einsum("tki,kij,tkj->tk", d, prior.precisions, d) + prior.costs).min(axis=1).sum()
    assert found == pytest.approx(total / rows)
