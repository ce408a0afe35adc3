import dataclasses
import subprocess
import sys

import numpy as np
import pytest
import torch

from readygo.benchmarks.motion.paths import circle, floor, line, s_curve
from readygo.common.errors import ConfigError, MotionError
from readygo.common.frames import matrix_from_axis_angle, yup_from_zup, zup_from_yup
from readygo.common.messages import AnimateRequest, EpisodeKey, HumanTrajectory, Scenario, Split, encode
from readygo.services.animator import Animator, AnimatorConfig, handle_animate, skeleton_of
from readygo.services.animator.gait.quality import joints_of, measure
from readygo.services.animator.priormdm import features as hml
from readygo.services.animator.priormdm.network import Mdm
from readygo.services.animator.priormdm.placement import HUMANML3D_LEG_M
from readygo.services.animator.priormdm.source import SETTLE_FRAMES, PriorMdm
from tests.services.animator.bodies import make_avatar
from tests.services.animator.priormdm.networks import SMALL


class Replay(Mdm):
    """A model that knows a motion and always predicts it."""

    def forward(self, x, step, text=None, valid=None):
        return self.motion[None, : x.shape[1]].expand(len(x), -1, -1)


@pytest.fixture
def source(release):
    return PriorMdm.load(release[1])


@pytest.fixture
def walker(avatar):
    return skeleton_of(avatar)


def walked_features(animate, avatar, xy):
    """Features of our own walk on HumanML3D's skeleton size, balls of the feet at 0, its last pose held."""
    skeleton = skeleton_of(avatar)
    _, P = joints_of(animate(xy, floor()), avatar)
    joints = yup_from_zup(P)
    joints[..., 1] -= skeleton.toe_sole_m
    joints = np.concatenate([joints, np.repeat(joints[-1:], 260 - len(joints), axis=0)])
    return P, hml.encode(joints * (HUMANML3D_LEG_M / skeleton.leg_m))[0]


def path_features(xy, frames):
    held = np.concatenate([xy, np.repeat(xy[-1:], frames + 1 - len(xy), axis=0)])
    return hml.encode_path(np.ascontiguousarray(held[:, 0]), -held[:, 1], np.zeros(len(held)))


@pytest.mark.parametrize("xy", [s_curve(1.2), circle(0.8), line(1.4, 28.0)], ids=["s", "circle", "560 rows"])
def test_root_is_on_the_path_and_stands_at_its_end(source, walker, xy):
    motion = source.walk(walker, xy, floor(), np.random.default_rng(0))
    assert len(motion.root_m) == len(xy) + SETTLE_FRAMES
    assert np.abs(motion.root_m[: len(xy), :2] - xy).max() < 2e-6
    assert np.abs(motion.root_m[len(xy) :, :2] - xy[-1]).max() < 2e-6
    assert np.isfinite(motion.pose_axis_angle).all()


@pytest.mark.parametrize("sampler", ["ddpm", "ddim"])
def test_decoded_features_have_the_asked_path(source, sampler):
    xy = s_curve(1.3)
    source.config = dataclasses.replace(source.config, sampler=sampler)
    path = path_features(xy, 220)
    features = source.complete(path, np.random.default_rng(0))
    assert np.array_equal(features[:, hml.PATH], path)
    joints = hml.decode_joints(features[: len(xy)], hml.Start(float(xy[0, 0]), float(-xy[0, 1]), 0.0))
    assert np.abs(zup_from_yup(joints)[:, 0, :2] - xy).max() < 1e-6


def test_same_seed_gives_the_same_bytes_and_another_does_not(source, walker):
    def run(seed):
        return encode(source.walk(walker, s_curve(1.0)[:100], floor(), np.random.default_rng(seed)))

    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        first = run(3)
        torch.set_num_threads(1)
        assert first == run(3)
        assert first != run(4)
    finally:
        torch.set_num_threads(before)


def test_drawing_leaves_torchs_own_stream_and_threads_alone(source, walker):
    torch.manual_seed(5)
    state, threads = torch.get_rng_state(), torch.get_num_threads()
    source.walk(walker, line(1.0, 2.0), floor(), np.random.default_rng(0))
    assert torch.equal(torch.get_rng_state(), state)
    assert torch.get_num_threads() == threads


def test_long_motion_has_no_jumps_where_windows_meet(source):
    features = source.complete(path_features(line(1.2, 30.0), 600), np.random.default_rng(0))
    steps = np.abs(np.diff((features - source.model.mean) / source.model.std, axis=0)).mean(axis=1)
    borders = [156, 195, 312, 351, 404, 507]
    away = np.ones(len(steps), np.bool_)
    for border in borders:
        away[border - 3 : border + 3] = False
    for border in borders:
        assert steps[border - 3 : border + 3].max() < 1.2 * steps[away].max()


def test_padding_of_masked_models_does_not_change_the_motion(source, walker):
    masked = PriorMdm(dataclasses.replace(source.model, mask_frames=True), source.config)
    short = path_features(line(1.0, 4.0), 196)
    other = short.copy()
    other[90:, :3] = 0.3
    a = masked.complete(short, np.random.default_rng(0), 90)
    b = masked.complete(other, np.random.default_rng(0), 90)
    assert np.array_equal(a[:90], b[:90])
    a = source.complete(short, np.random.default_rng(0), 90)
    b = source.complete(other, np.random.default_rng(0), 90)
    assert not np.array_equal(a[:90], b[:90])


def test_text_guides_the_motion(release, monkeypatch):
    folder, config = release
    np.save(folder / "walks.npy", np.random.default_rng(0).standard_normal(512).astype(np.float32))
    worded = PriorMdm.load(dataclasses.replace(config, text_embedding=str(folder / "walks.npy")))
    path = path_features(line(1.0), 200)
    a = worded.complete(path, np.random.default_rng(0))
    b = PriorMdm.load(config).complete(path, np.random.default_rng(0))
    assert not np.allclose(a, b, atol=1e-3)
    monkeypatch.setattr("readygo.services.animator.priormdm.source.GUIDANCE", 0.0)
    assert worded.complete(path, np.random.default_rng(0)) == pytest.approx(b, abs=1e-5)


@pytest.mark.parametrize(
    "ground", [floor(), floor(lambda x, y: 0.1 * x + 0.05 * y), floor(lambda x, y: 0.03 * np.sin(2 * x))]
)
def test_model_that_predicts_a_walk_gives_that_walk_on_any_floor(source, animate, avatar, walker, ground):
    xy = s_curve(1.2)
    P, features = walked_features(animate, avatar, xy)
    network = Replay(SMALL)
    network.motion = torch.from_numpy(((features - source.model.mean) / source.model.std).astype(np.float32))
    replay = PriorMdm(dataclasses.replace(source.model, network=network), source.config)
    rows = 170
    motion = replay.walk(walker, xy[:rows], ground, np.random.default_rng(0))
    motion = dataclasses.replace(motion, root_m=motion.root_m[:rows], pose_axis_angle=motion.pose_axis_angle[:rows])
    quality = measure(motion, avatar, ground, xy[:rows])
    assert quality.root_error_max_cm < 0.001
    assert quality.penetration_max_mm < 15.0
    assert quality.hover_max_mm < 10.0
    assert 0.0 < quality.knee_min_deg < quality.knee_max_deg < 80.0
    if float(np.ptp(ground.height_m)) == 0.0:
        _, Q = joints_of(motion, avatar)
        assert np.sqrt(np.sum((Q - P[:rows]) ** 2, axis=2)).mean() < 0.02


def test_motion_of_one_point_stands_there(source, walker):
    motion = source.walk(walker, np.array([[1.0, -2.0]]), floor(), np.random.default_rng(0))
    assert motion.root_m[:, :2] == pytest.approx(np.tile([1.0, -2.0], (1 + SETTLE_FRAMES, 1)), abs=1e-6)


@pytest.mark.parametrize(
    ("xy", "message"),
    [
        (np.zeros((0, 2)), "at least one row"),
        (np.array([[0.0, 0.0], [np.nan, 0.0]]), "Row 1 of the trajectory is not finite"),
        (np.array([[0.0, 0.0], [0.3, 0.0]]), "jumps at 6.0 m/s"),
    ],
)
def test_trajectories_that_nobody_can_follow_are_refused(source, walker, xy, message):
    with pytest.raises(MotionError, match=message):
        source.walk(walker, xy, floor(), np.random.default_rng(0))


def test_weights_that_are_not_finite_are_refused(source, walker):
    source.model.network.output_process.poseFinal.bias.fill_(float("nan"))
    with pytest.raises(ConfigError, match="not finite; check the weights"):
        source.walk(walker, line(1.0, 2.0), floor(), np.random.default_rng(0))


def test_more_steps_than_trained_are_refused(release):
    with pytest.raises(ConfigError, match=r"priormdm.steps must be within 0\.\.50"):
        PriorMdm.load(dataclasses.replace(release[1], steps=51))


def jerkiness(motion):
    """Mean square of the second difference of the body's joint rotations over time, hands and toes aside."""
    R = matrix_from_axis_angle(motion.pose_axis_angle[:, [1, 2, 4, 5, 16, 17, 18, 19]].astype(float))
    return float(np.square(R[2:] - 2.0 * R[1:-1] + R[:-2]).mean())


def test_refinement_smooths_limbs_and_keeps_root_and_toes(release, walker):
    path = line(1.0, 1.0)
    plain, refined, again = (
        PriorMdm.load(dataclasses.replace(release[1], refine=how)).walk(walker, path, floor(), np.random.default_rng(0))
        for how in ("none", "limits", "limits")
    )
    assert jerkiness(refined) < 0.8 * jerkiness(plain)
    assert np.array_equal(refined.root_m, plain.root_m)
    assert np.array_equal(refined.pose_axis_angle[:, 10:12], plain.pose_axis_angle[:, 10:12])
    assert encode(refined) == encode(again)


def test_pose_prior_of_the_user_makes_poses_likelier(release, walker):
    folder, config = release
    path = folder / "gmm_08.npz"
    np.savez(path, means=np.zeros((1, 69)), covars=0.01 * np.eye(69)[None], weights=np.ones(1))
    config = dataclasses.replace(config, refine="prior", pose_prior=str(path))
    plain, refined = (
        PriorMdm.load(one).walk(walker, line(1.0, 1.0), floor(), np.random.default_rng(0))
        for one in (release[1], config)
    )
    body = [j for j in range(1, 24) if j not in (10, 11)]
    assert np.square(refined.pose_axis_angle[:, body]).sum() < 0.9 * np.square(plain.pose_axis_angle[:, body]).sum()
    assert np.array_equal(refined.root_m, plain.root_m)


def test_missing_pose_prior_is_named(release):
    config = dataclasses.replace(release[1], refine="prior", pose_prior=str(release[0] / "gone.pkl"))
    with pytest.raises(ConfigError, match=r"gone\.pkl cannot be read.*give SMPLify's gmm_08\.pkl"):
        PriorMdm.load(config)


def test_animator_answers_with_motions_of_the_model(release):
    bodies = {"ada": make_avatar("ada"), "bob": make_avatar("bob", 1.1)}
    animator = Animator(bodies, floor(), AnimatorConfig(source="priormdm", priormdm=release[1]))

    def ask(*trajectories):
        humans = [HumanTrajectory(avatar=n, encounter="crossing", speed_mps=1.0, xy_m=xy) for n, xy in trajectories]
        key = EpisodeKey(seed=1, split=Split.TRAIN, index=5)
        scenario = Scenario(episode=key, start_xyyaw=np.zeros(3), goal_xy_m=np.ones(2), humans=tuple(humans))
        return handle_animate(animator, AnimateRequest(scenario=scenario))

    first = ask(("ada", line(1.0, 3.0)), ("bob", circle(0.9)[:60]))
    assert first.rejected == ""
    other = ask(("ada", line(0.7, 3.0)), ("bob", circle(0.9)[:60]))
    assert encode(first.motions.humans[1].motion) == encode(other.motions.humans[1].motion)
    broken = line(1.0, 3.0)
    broken[4] = np.inf
    assert ask(("ada", broken)).rejected.startswith("motion: Row 4")


def test_animator_without_the_weights_at_hand_says_so(release):
    config = dataclasses.replace(release[1], weights=str(release[0] / "gone.pt"))
    with pytest.raises(ConfigError, match=r"gone\.pt cannot be read: no such file"):
        Animator({}, floor(), AnimatorConfig(source="priormdm", priormdm=config))


def test_gait_loads_no_torch():
    code = "import services.animator, sys; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
