from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("torch", reason="torch is not installed")

from readygo.benchmarks.policy import policy as bench


def test_every_method_drives_the_same_tasks(monkeypatch) -> None:
    driven = []

    def drive(rooms, task, command):
        driven.append(task)
        return ("success" if task > 0.5 else "timeout"), []

    monkeypatch.setattr(bench, "draw_task", lambda rooms, rng: rng.random())
    monkeypatch.setattr(bench, "drive", drive)
    counts = [bench.count_successes(None, 10, lambda task: None) for _ in range(2)]
    assert driven[:10] == driven[10:]
    assert counts == [sum(task > 0.5 for task in driven[:10])] * 2


@pytest.mark.parametrize(("answer", "command"), [((0.5, -0.25), (0.5, -0.25)), ((np.nan, 0.1), (0.0, 0.0))])
def test_policy_keeps_its_memory_and_stops_where_it_knows_nothing(answer, command) -> None:
    seen = []

    def step(memories, images, previous, goals):
        seen.append((memories[0], images.shape, previous.tolist(), goals.tolist()))
        return np.array([answer], np.float32)

    drive = bench.policy_command(SimpleNamespace(start=lambda: "memory", step=step))
    for _ in range(2):
        assert drive(np.zeros((2, 3, 3), np.uint8), (1.0, 2.0), (0.5, 0.0), None) == command
    assert seen == [("memory", (1, 2, 3, 3), [[0.5, 0.0]], [[1.0, 2.0]])] * 2
