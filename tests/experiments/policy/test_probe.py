import json
import math

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra train")

from experiments.policy.probe import (
    HELD_OUT,
    append,
    auc,
    auc_within_states,
    config_of,
    presence_scores,
    probe,
    risk_scores,
)
from readygo.common.errors import ConfigError, DatasetError
from tests.services.trainer.conftest import make_source

QUICK = ("samples=256", "batch_size=32", "latent_count=4", "precision=fp32", "widths=[4, 4, 4, 4, 4]")


@pytest.mark.parametrize(
    ("scores", "expected"), [([1, 2, 3, 4], 1.0), ([4, 3, 2, 1], 0.0), ([1, 3, 2, 4], 0.75), ([5, 5, 5, 5], 0.5)]
)
def test_auc_counts_ordered_pairs_and_half_of_the_ties(scores, expected):
    assert auc(np.array(scores, np.float32), np.array([False, False, True, True])) == expected


def test_auc_of_one_kind_alone_is_not_known():
    assert auc(np.ones(2), np.array([True, True])) is None
    assert auc(np.ones(2), np.array([False, False])) is None


def test_order_within_a_state_counts_apart_from_that_of_states():
    truth = np.array([[False, True], [False, True], [False, False]])
    logits = np.array([[0.0, 1.0], [10.0, 11.0], [20.0, 20.0]])
    scores = risk_scores(logits, truth, np.array([0.4, 0.1]))
    assert (scores["auc_within_state"], scores["auc_within_state_blind"]) == (1.0, 0.0)
    assert scores["states_that_vary"] == 2
    assert scores["auc"] == pytest.approx(3 / 8)
    assert scores["auc_blind"] == pytest.approx(1 / 8)
    assert scores["share"] == pytest.approx(1 / 3)
    assert auc_within_states(logits[2:], truth[2:]) is None


def test_humans_are_told_apart_by_distance_and_far_ones_do_not_count():
    distances_m = np.array([1.0, 3.0, 5.0, 8.0, 1.0])
    humans = np.stack([np.array([1, 1, 1, 1, 0]), np.full(5, 0.5), distances_m], axis=1)
    read = np.stack([np.array([3.0, 1.0, -1.0, 2.0, 0.0]), np.full(5, 0.4), np.log(1.25 * distances_m)], axis=1)
    scores = presence_scores(read, humans)
    assert (scores["auc_0_2_m"], scores["auc_2_4_m"], scores["auc_4_6_m"]) == (1.0, 0.5, 0.0)
    assert scores["auc"] == scores["share"] - 0.1 == 0.5
    assert scores["bearing_median_deg"] == pytest.approx(math.degrees(0.1))
    assert scores["distance_median_share"] == pytest.approx(0.25)


def test_errors_are_left_out_where_there_is_no_human():
    assert "bearing_median_deg" not in presence_scores(np.zeros((2, 3)), np.zeros((2, 3)))


def test_settings_come_over_the_recipe():
    config = config_of(["fusion=early", "frame_spacing_s=0.2", "widths=[8, 8, 8, 8, 8]"], 3.0)
    assert (config.network.fusion, config.sampling.frame_spacing_s) == ("early", 0.2)
    assert config.network.widths == (8, 8, 8, 8, 8)
    assert (config.minutes, config.threads, config.validation_fraction) == (3.0, 1, HELD_OUT)


@pytest.mark.parametrize("wrong", ["foo=1", "fusion=middle", "latent_count=many", "latent_count=0", "output=bins"])
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ConfigError, match=wrong.split("=")[0].replace("_", "[_-]")):
        config_of([wrong], 1.0)


def test_probe_scores_what_it_was_not_trained_on(monkeypatch):
    monkeypatch.setattr("readygo.services.trainer.views.MIRRORED", 0.0)
    monkeypatch.setattr("readygo.services.trainer.schedule.WARM_UP_STEPS", 1)
    source = make_source(episodes=10)
    source.has_expert = source.has_risks = True
    learning = ("samples=960", "ema_decay=0", "learning_rate=0.01")
    row = probe(source, config_of([*QUICK, *learning], 1.0))
    json.dumps(row)
    assert (row["training_episodes"], row["held_out_episodes"], row["samples_seen"]) == (8, 2, 960)
    assert row["cross_entropy"] > 0
    assert row["human_risk"]["share"] == pytest.approx(1 / 3 / 45, rel=0.1)
    # Obstacles are to the left in every state.
    assert row["obstacle_risk"]["auc_within_state"] > 0.8
    assert row["human_presence"]["share"] == 1.0


def test_presence_is_left_out_where_it_is_not_learned():
    source = make_source(episodes=4)
    source.has_expert = source.has_risks = True
    assert probe(source, config_of([*QUICK, "humans_weight=0"], 1.0))["human_presence"] is None


def test_data_without_risks_are_refused():
    source = make_source(episodes=4)
    source.has_expert = True
    with pytest.raises(DatasetError, match="risks"):
        probe(source, config_of(QUICK, 1.0))


def test_rows_are_appended(tmp_path):
    for number in range(2):
        append(tmp_path / "rows.json", {"number": number})
    assert json.loads((tmp_path / "rows.json").read_text()) == [{"number": 0}, {"number": 1}]
