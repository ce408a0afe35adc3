import pytest

from readygo.services.trainer import RECIPES, TrainConfig, best_recipe, with_overrides


@pytest.mark.parametrize(
    "wrong",
    [
        {"minutes": 0.0},
        {"samples": 0},
        {"batch_size": 0},
        {"ema_decay": 1.0},
        {"learning_rate": 0.0},
        {"ahead_s": -0.1},
        {"frame_spacing_s": 0.0},
        {"widths": (8, 8)},
    ],
)
def test_settings_that_make_no_sense_are_refused_by_name(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        with_overrides(TrainConfig(), **wrong)


def test_settings_reach_their_sections_and_none_changes_nothing():
    config = with_overrides(best_recipe(), minutes=2.0, hindsight=0.1, fusion="early", learning_rate=None)
    assert (config.minutes, config.sampling.hindsight, config.network.fusion) == (2.0, 0.1, "early")
    assert config.optimizer == best_recipe().optimizer


def test_recipes_differ_in_what_they_say_they_do():
    best, fast, paper = (RECIPES[name]() for name in ("best", "fast", "paper"))
    assert paper.network == fast.network
    assert (paper.network.motion, best.network.motion) == ("command", "poses")
    assert (paper.optimizer.learning_rate, paper.optimizer.decay_share, paper.optimizer.weight_decay) == (1e-4, 0, 0)
    assert best.sampling.ahead_s == 0.4
