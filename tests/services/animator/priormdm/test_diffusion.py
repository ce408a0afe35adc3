import math

import numpy as np
import pytest

from readygo.services.animator.priormdm.diffusion import cosine_schedule, sample


def test_cosine_schedule_has_the_published_signal():
    schedule = cosine_schedule(1000)

    def signal(t):
        return math.cos((t + 0.008) / 1.008 * math.pi / 2.0) ** 2

    expected = [signal((i + 1) / 1000) / signal(0.0) for i in range(990)]
    assert schedule.alpha_bar[:990] == pytest.approx(expected, rel=1e-9)
    assert schedule.step == tuple(range(1000))
    assert 0.0 < schedule.alpha_bar[-1] < 1e-5


def test_respaced_schedule_keeps_the_signal_of_its_steps():
    full, few = cosine_schedule(1000), cosine_schedule(1000, 10)
    assert few.step == (0, 111, 222, 333, 444, 555, 666, 777, 888, 999)
    assert few.alpha_bar == tuple(full.alpha_bar[i] for i in few.step)
    with pytest.raises(ValueError, match=r"within 0\.\.1000"):
        cosine_schedule(1000, 1001)


@pytest.mark.parametrize("sampler", ["ddpm", "ddim"])
def test_steps_of_a_perfect_model_follow_the_forward_process(sampler):
    """With the true clean motion, x keeps the mean and variance that the noise schedule gives it."""
    schedule = cosine_schedule(100)
    clean = np.full((400, 263), 2.0, np.float32)
    seen = {}

    def predict(x, step):
        seen[step] = float(x.mean()), float(x.var())
        return clean

    none = np.zeros(clean.shape, np.bool_)
    result = sample(predict, clean, none, schedule, np.random.default_rng(0), sampler=sampler)
    assert np.array_equal(result, clean)
    for i in (80, 50, 20, 5):
        mean, variance = seen[schedule.step[i]]
        assert mean == pytest.approx(2.0 * math.sqrt(schedule.alpha_bar[i]), abs=0.02)
        assert variance == pytest.approx(1.0 - schedule.alpha_bar[i], abs=0.02)


@pytest.mark.parametrize("sampler", ["ddpm", "ddim"])
def test_known_features_carry_no_noise_and_return_exactly(sampler):
    schedule = cosine_schedule(20)
    rng = np.random.default_rng(1)
    known = rng.standard_normal((50, 263))
    is_known = np.zeros(known.shape, np.bool_)
    is_known[:, :3] = True

    def predict(x, step):
        share = math.sqrt(schedule.alpha_bar[step])
        assert x[:, :3] == pytest.approx(share * known[:, :3], abs=1e-5)
        return np.full_like(x, 9.0)

    drawn = sample(predict, known, is_known, schedule, rng, sampler=sampler)
    assert np.array_equal(drawn[:, :3], known[:, :3].astype(np.float32))
    assert (drawn[:, 3:] == 9.0).all()


@pytest.mark.parametrize("sigma_small", [True, False])
def test_steps_are_those_of_the_posterior_of_two_gaussians(sigma_small):
    """q(x_before | x_now, clean) by completing the square; Ho, Jain and Abbeel, 2020, equations 6 and 7."""
    schedule = cosine_schedule(60, 13, sigma_small=sigma_small)
    for i in range(1, 13):
        now, before = schedule.alpha_bar[i], schedule.alpha_bar[i - 1]
        alpha = now / before
        # Precisions of x_before: from the clean motion forwards, and from x_now backwards.
        forwards, backwards = 1.0 / (1.0 - before), alpha / (1.0 - alpha)
        variance = 1.0 / (forwards + backwards)
        clean, noisy, sigma = schedule.posterior(i)
        assert clean == pytest.approx(variance * forwards * math.sqrt(before))
        assert noisy == pytest.approx(variance * backwards / math.sqrt(alpha))
        assert sigma == pytest.approx(math.sqrt(variance if sigma_small else 1.0 - alpha))
        a, b = schedule.ddim(i)
        # The same noise: x_now = sqrt(now) clean + sqrt(1 - now) noise.
        assert a + b * math.sqrt(now) == pytest.approx(math.sqrt(before))
        assert b * math.sqrt(1.0 - now) == pytest.approx(math.sqrt(1.0 - before))
    assert schedule.before(0) == 1.0
    assert cosine_schedule(60, 1).step == (59,)
    assert len(cosine_schedule(60).step) == 60


@pytest.mark.parametrize("sampler", ["ddpm", "ddim"])
def test_motion_of_a_seed_is_as_it_was(sampler, golden_figures):
    is_known = np.zeros((12, 5), np.bool_)
    is_known[:, :2] = True
    known = np.random.default_rng(3).normal(size=(12, 5))
    drawn = sample(
        lambda x, step: (0.7 * np.tanh(x) + 0.01 * step).astype(np.float32),
        known, is_known, cosine_schedule(40, 9), np.random.default_rng(5), sampler=sampler,
    )  # fmt: skip
    golden_figures(f"priormdm/sample {sampler}", drawn)
