from pathlib import Path

import pytest

from readygo.apps.observe.traces import Traces, trace_numbers
from readygo.common.errors import ConfigError

pytest.importorskip("opentelemetry.sdk", reason="opentelemetry-sdk (the extra `otel`) is not installed")


def test_numbers_are_those_of_run_and_episode() -> None:
    assert trace_numbers("run", "train-0-000001") == trace_numbers("run", "train-0-000001")
    others = {trace_numbers(run, episode) for run in ("a", "b") for episode in ("1", "2")}
    assert len(others) == 4
    assert all(0 < trace < 2**128 and 0 < span < 2**64 for trace, span in others)


def test_folder_that_cannot_be_written_is_said_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="--traces cannot write"):
        Traces(str(tmp_path / "file"), run="run", role="all", worker="all0")


def test_request_of_nothing_that_is_traced_leaves_no_span(tmp_path: Path) -> None:
    traces = Traces(str(tmp_path), run="run", role="all", worker="all0")
    with traces.requesting("ctl/status"), traces.handling("ctl/status"):
        pass
    traces.close()
    assert (tmp_path / "all0.jsonl").read_text() == ""
