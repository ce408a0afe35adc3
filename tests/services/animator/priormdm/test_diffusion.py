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
