import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest

from readygo.benchmarks.rasterizer.runs import STAGES, make_backend, measure, measure_in_processes, stages_ms
from readygo.benchmarks.rasterizer.setting import Setting
from readygo.common.errors import ConfigError
from readygo.common.images.images import Images
from readygo.common.rasterizer.interface import View
from tests.benchmarks.rasterizer.conftest import JOB


def test_every_stage_is_called_by_an_image_with_humans(setting: Setting) -> None:
    before = [getattr(module, name) for functions in STAGES.values() for module, name in functions]
    spent_ms = stages_ms(setting, make_backend(setting))
    assert all(ms > 0 for ms in spent_ms.values())
    assert before == [getattr(module, name) for functions in STAGES.values() for module, name in functions]


def test_processes_measure_the_same_number_of_images_each() -> None:
    timings = measure_in_processes(dataclasses.replace(JOB, threads=2, frames=4, views=1))
    assert [timing.cpu_s.shape for timing in timings] == [(4, 1, 1)] * 2
    assert all((timing.cpu_s > 0).all() for timing in timings)


def test_process_that_fails_ends_the_measurement_with_its_error() -> None:
    with pytest.raises(ConfigError, match="exclude each other"):
        measure_in_processes(dataclasses.replace(JOB, threads=1, scene="embedded"))


def test_only_images_after_the_first_of_a_view_are_timed(setting: Setting) -> None:
    drawn: list[View] = []

    class Recorder:
        views_at_once = 1

        def render(self, views: Sequence[View], outputs: Sequence[str] = ("rgb",)) -> Images:
            drawn.extend(views)
            return Images(rgb=np.zeros((len(views), 1, 1, 3), dtype=np.uint8))

    timing = measure(setting, Recorder())
    assert timing.cpu_s.shape == timing.wall_s.shape == (4, 2, 2)
    # Two views for warming up, then per run and view one image that is not timed and two that are.
    assert len(drawn) == 2 + 4 * 2 * 3
