import pytest

from readygo.apps.learn.choice import PolicyMeasurement, best_of, episodes_to_measure, has_stopped_rising


def measured(fraction: float, static: float, dynamic: float = 0.0, episodes: int = 20) -> PolicyMeasurement:
    return PolicyMeasurement(fraction=fraction, policy=f"{fraction}", episodes=episodes, static=static, dynamic=dynamic)


def test_both_tasks_count_alike() -> None:
    assert best_of([measured(0.1, 0.9, 0.1), measured(0.2, 0.4, 0.8), measured(0.3, 0.6, 0.3)]) == 1


def test_later_one_of_equals_is_kept() -> None:
    assert best_of([measured(0.1, 0.5), measured(0.2, 0.5), measured(0.3, 0.4)]) == 1


def test_few_lucky_episodes_do_not_beat_many_good_ones() -> None:
    assert best_of([measured(0.1, 1.0, 1.0, episodes=4), measured(0.2, 0.95, 0.9, episodes=40)]) == 1
    assert best_of([measured(0.1, 0.25, 0.0, episodes=4), measured(0.2, 0.15, 0.05, episodes=40)]) == 1


def test_nothing_is_kept_before_anything_is_measured() -> None:
    assert best_of([]) is None
    assert not has_stopped_rising([], 1.0, 0.1)


def test_it_ends_when_the_rate_has_not_risen_for_long_and_in_several_measurements() -> None:
    risen = [measured(0.1, 0.2), measured(0.2, 0.8)]
    flat = [measured(0.2 + 0.1 * k, 0.7) for k in range(1, 5)]
    assert not has_stopped_rising(risen + flat, 0.65, 0.5)
    assert has_stopped_rising(risen + flat, 0.75, 0.5)
    assert not has_stopped_rising(risen + flat[:3], 0.9, 0.5)
    assert not has_stopped_rising([*risen, *flat, measured(0.65, 0.9)], 0.9, 0.5)


def test_few_episodes_do_not_tell_that_the_rate_has_stopped_rising() -> None:
    # What `learn` measured in the showroom: 9 episodes, and then 5 or 6 of better policies.
    best = [measured(0.1, 8 / 9, 3 / 9, episodes=9)]
    later = [measured(0.2 + 0.1 * k, 1.0, 0.2, episodes=5) for k in range(5)]
    assert best_of(best + later) == 0
    assert not has_stopped_rising(best + later, 0.7, 0.5)
    worse = [measured(0.2 + 0.1 * k, 0.6, 0.0, episodes=5) for k in range(5)]
    assert has_stopped_rising(best + worse, 0.7, 0.5)
    many = [measured(0.1, 0.9, 0.4, episodes=90), *(measured(0.2 + 0.1 * k, 0.9, 0.38, episodes=90) for k in range(5))]
    assert has_stopped_rising(many, 0.7, 0.5)


def test_measurement_takes_its_share_of_time_and_never_less_than_says_something() -> None:
    assert episodes_to_measure(60.0, 1.5, 50) == 20
    assert episodes_to_measure(1.0, 1.5, 50) == 4
    assert episodes_to_measure(1000.0, 1.5, 50) == 50
    assert episodes_to_measure(60.0, 1.5, 2) == 2


def test_score_is_the_lower_end_of_wilsons_interval_of_both_tasks() -> None:
    # 20 static and 20 dynamic episodes, of which 16 and 4 succeeded.
    p, n, z = 0.5, 40, 1.959964
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * (p * (1 - p) / n + z * z / (4 * n * n)) ** 0.5
    assert measured(0.1, 0.8, 0.2).score == pytest.approx(middle - half, abs=1e-6)


def test_patience_is_counted_from_the_best_and_reached_at_its_end() -> None:
    best = [measured(0.25, 0.8)]
    assert has_stopped_rising([*best, *[measured(0.5, 0.7)] * 4], 0.75, 0.5)
    assert not has_stopped_rising([*best, *[measured(0.5, 0.7)] * 4], 0.74, 0.5)
    assert not has_stopped_rising([*best, *[measured(0.5, 0.7)] * 3], 0.75, 0.5)


def test_two_tasks_share_the_time_of_a_measurement() -> None:
    assert episodes_to_measure(59.9, 3.0, 50) == 9
    assert episodes_to_measure(60.0, 3.0, 50) == 10
