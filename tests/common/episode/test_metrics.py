import pytest

from readygo.common.episode import EpisodeResult, summarize, wilson_interval
from readygo.common.messages import Outcome


def _result(outcome=Outcome.SUCCESS, duration_s=10.0, path_m=8.0, shortest_m=8.0):
    return EpisodeResult(outcome=outcome, duration_s=duration_s, path_length_m=path_m, shortest_m=shortest_m)


def test_failed_episodes_count_as_the_time_limit():
    results = [_result(), _result(Outcome.HUMAN_COLLISION, duration_s=2.0)]
    assert summarize(results, time_limit_s=50.0).art_s == 30.0


def test_rates_add_up():
    results = [_result(outcome) for outcome in Outcome] + [_result()] * 4
    summary = summarize(results, time_limit_s=50.0)
    assert summary.success_rate == 5 / 8
    assert summary.static_collision_rate == summary.human_collision_rate == summary.timeout_rate == 1 / 8
    assert summary.success_rate_low < 5 / 8 < summary.success_rate_high


def test_spl_punishes_detours_and_failures_and_never_exceeds_one():
    results = [_result(path_m=16.0), _result(path_m=7.9), _result(Outcome.TIMEOUT)]
    assert summarize(results, time_limit_s=50.0).spl == pytest.approx((0.5 + 1.0) / 3)


def test_wilson_interval_of_known_cases():
    assert wilson_interval(8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert wilson_interval(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert wilson_interval(100, 100) == pytest.approx((0.9630, 1.0), abs=1e-4)


def test_nothing_to_summarize_is_refused():
    with pytest.raises(ValueError, match="at least one"):
        summarize([], time_limit_s=50.0)
    with pytest.raises(ValueError, match="success_count"):
        wilson_interval(3, 2)


def test_result_takes_its_length_from_the_actions(simulate):
    simulation = simulate(goal=(5.0, 0.0))
    while simulation.outcome is None:
        simulation.advance(1.0, 0.0)
    result = EpisodeResult.from_trajectory(simulation.trajectory(), 4.0)
    assert result.path_length_m == pytest.approx(4.0, abs=0.05)
    assert result.outcome is Outcome.SUCCESS
