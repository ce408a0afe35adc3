import numpy as np

from readygo.benchmarks.rasterizer.outputs import SETS, _fastest_ms
from readygo.common.images.images import OUTPUTS


def test_fastest_run_of_each_set_counts(monkeypatch) -> None:
    asked = []

    class Recorder:
        def render(self, views, names):
            asked.append(names)

    spent_s = iter([9.0] * 6 + [0.006, 0.005, 0.004, 0.003, 0.002, 0.001])
    now = [0.0, False]

    def thread_time() -> float:
        now[0], now[1] = now[0] + (next(spent_s) if now[1] else 0.0), not now[1]
        return now[0]

    monkeypatch.setattr("readygo.benchmarks.rasterizer.outputs.time.thread_time", thread_time)
    np.testing.assert_allclose(_fastest_ms(Recorder(), 1, None), [6.0, 5.0, 4.0, 3.0, 2.0, 1.0], rtol=1e-9)
    assert asked == [*SETS, *SETS]


def test_sets_are_of_images_that_there_are_and_begin_with_rgb_alone() -> None:
    assert SETS[0] == ("rgb",)
    assert all(name in OUTPUTS for names in SETS for name in names)
    assert SETS[-1] == OUTPUTS
