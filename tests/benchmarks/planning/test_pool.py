import threading
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from readygo.benchmarks.planning.maps import MapSource
from readygo.benchmarks.planning.pool import draws, processes
from readygo.benchmarks.planning.runs import REJECTED_MAX, Draw, PlanningJob
from readygo.common.errors import SceneError
from readygo.common.maps import GridFrame, OccupancyMap, save_ros_map

JOB = PlanningJob(source=MapSource(name="none", path="none"), modes=("paper",), tasks=("static",), seed=0)


def done(draw):
    future = Future()
    future.set_result(draw)
    return future


def every_third_rejected(job, index):
    return done(Draw(index=index, rejected="too narrow" if index % 3 == 0 else ""))


@pytest.mark.parametrize("ahead", [1, 2, 7])
def test_draws_end_with_the_last_accepted_one_however_many_run_at_a_time(ahead):
    found = list(draws(JOB, 4, every_third_rejected, ahead))
    assert [draw.index for draw in found] == [0, 1, 2, 3, 4, 5]
    assert [bool(draw.rejected) for draw in found] == [True, False, False, True, False, False]


@pytest.mark.parametrize("ahead", [1, 5])
def test_pictures_are_those_of_the_draws_that_count(tmp_path, ahead):
    def drawn(job, index):
        return done(Draw(index=index, pictures={f"map/{index}.png": b"png"}))

    found = list(draws(replace(JOB, pictures=tmp_path), 3, drawn, ahead))
    assert sorted(path.name for path in (tmp_path / "map").iterdir()) == ["0.png", "1.png", "2.png"]
    assert all(not draw.pictures for draw in found)


def test_draws_come_in_order_when_later_ones_are_ready_first():
    third_done = threading.Event()

    def work(index):
        if index == 0:
            assert third_done.wait(30)
        if index == 2:
            third_done.set()
        return Draw(index=index)

    with ThreadPoolExecutor(3) as pool:
        found = [draw.index for draw in draws(JOB, 5, lambda job, index: pool.submit(work, index), 3)]
    assert found == [0, 1, 2, 3, 4]


def test_map_that_rejects_everything_is_refused():
    with pytest.raises(SceneError, match=f"{REJECTED_MAX} draws in a row.*'too narrow'"):
        list(draws(JOB, 1, lambda job, index: done(Draw(index=index, rejected="too narrow")), 4))


def test_map_without_free_space_is_refused(tmp_path):
    full = OccupancyMap(
        frame=GridFrame(origin_x_m=0, origin_y_m=0, resolution_m=0.05), occupied=np.ones((50, 50), bool)
    )
    save_ros_map(full, tmp_path / "full.yaml")
    job = PlanningJob(
        source=MapSource(name="full", path=str(tmp_path / "full.yaml")), modes=("paper",), tasks=("static",), seed=0
    )
    with processes(1) as submit, pytest.raises(SceneError, match="no free space"):
        list(draws(job, 1, submit, 1))
