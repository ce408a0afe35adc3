import time

import pytest

from experiments.policy.labelled import Clock


class _Worker:
    def work(self, seconds: float) -> float:
        end_s = time.thread_time() + seconds
        while time.thread_time() < end_s:
            pass
        return seconds


def test_clock_counts_the_cpu_time_of_a_method_and_changes_nothing_else() -> None:
    clock, worker = Clock(), _Worker()
    clock.watch("work", worker, "work")
    assert worker.work(0.02) == 0.02
    worker.work(0.01)
    assert clock.spent_s["work"] == pytest.approx(0.03, abs=0.01)
