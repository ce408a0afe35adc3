import pytest

from readygo.apps.learn.cores import CoreSplit, is_ahead, shared_out, split_cores


def split(
    cores: int, *, scenes: int = 1, collect_hz: float = 100.0, train_hz: float = 800.0, reuse: float = 4.0
) -> CoreSplit:
    return split_cores(cores, scenes=scenes, collect_hz=collect_hz, train_hz=train_hz, reuse=reuse)


def test_two_cores_are_one_for_each() -> None:
    assert split(2) == split(2, reuse=100.0) == split(2, reuse=0.01) == CoreSplit(1, 1)


def test_one_core_is_shared() -> None:
    assert split(1) == CoreSplit(1, 1)


def test_every_sample_is_learned_from_as_often_as_wanted() -> None:
    halves = split(12)
    assert halves == CoreSplit(8, 4)
    assert halves.trainer_threads * 800.0 / (halves.collectors * 100.0) == pytest.approx(4.0)
    assert split(12, reuse=16.0) == CoreSplit(4, 8)


def test_faster_trainer_gets_fewer_cores() -> None:
    counts = [split(16, train_hz=hz).trainer_threads for hz in (200.0, 800.0, 3200.0)]
    assert counts == sorted(counts, reverse=True)
    assert len(set(counts)) == 3


def test_every_scene_has_a_collector_however_few_cores_there_are() -> None:
    assert split(2, scenes=3) == CoreSplit(3, 1)
    assert shared_out(3, 3) == [1, 1, 1]
    assert shared_out(7, 3) == [3, 2, 2]
    assert shared_out(1, 2) == [1, 1]
    assert shared_out(0, 2) == [0, 0]


def test_collecting_waits_for_training_and_never_at_first() -> None:
    assert is_ahead(learned=0, recorded=9_000, reuse=4.0)
    assert not is_ahead(learned=0, recorded=11_000, reuse=4.0)
    assert is_ahead(learned=40_000, recorded=20_000, reuse=4.0)
    assert not is_ahead(learned=39_000, recorded=20_000, reuse=4.0)


def test_lead_of_collecting_is_ten_thousand_samples_to_the_sample() -> None:
    assert is_ahead(learned=30, recorded=10_010, reuse=3.0)
    assert not is_ahead(learned=29, recorded=10_010, reuse=3.0)


def test_cores_go_to_collectors_as_the_formula_has_it() -> None:
    for cores, collect_hz, train_hz, reuse in ((7, 90.0, 410.0, 3.0), (16, 55.0, 700.0, 5.0), (24, 130.0, 300.0, 2.5)):
        found = split(cores, collect_hz=collect_hz, train_hz=train_hz, reuse=reuse)
        assert found.collectors == round(cores * train_hz / (train_hz + reuse * collect_hz))
        assert found.collectors + found.trainer_threads == cores


def test_collectors_that_are_shared_out_are_all_of_them() -> None:
    for collectors in range(5, 14):
        shares = shared_out(collectors, 5)
        assert sum(shares) == collectors
        assert max(shares) - min(shares) <= 1
