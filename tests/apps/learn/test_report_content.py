import pytest

from readygo.apps.learn.report_content import RunNumbers


def test_speed_is_of_the_whole_run() -> None:
    assert RunNumbers(episodes=2, samples=90, images=18, learned=0, wall_s=4.5).samples_per_s == pytest.approx(20.0)


def test_run_that_took_no_time_has_no_speed() -> None:
    assert RunNumbers(episodes=0, samples=0, images=0, learned=0, wall_s=0.0).samples_per_s == 0.0
