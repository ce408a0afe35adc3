import json
import shutil
import sys
from pathlib import Path

import pytest

from readygo.benchmarks.fleet.chaos import BenchChaosOptions, bench_chaos, compare, small_disk
from readygo.common.dataset import validate
from readygo.common.errors import ConfigError
from tests.apps.fleet.toy_line import DRAW, FILM, in_process, make_folder

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")


def _recorded(path: Path, *, wanted: int = 4) -> Path:
    folder = make_folder(path, (DRAW, FILM), wanted=wanted, recorders=("rec0", "rec1"))
    assert in_process(folder, (DRAW, FILM)).finished
    return path


def test_equal_runs_are_equal(tmp_path: Path) -> None:
    alone, data = _recorded(tmp_path / "alone"), _recorded(tmp_path / "data")
    outcome = compare([alone], [data], validate(data))
    assert outcome.ok
    assert outcome.episodes == 4


def test_missing_double_torn_and_wrong_episodes_are_found(tmp_path: Path) -> None:
    alone, data = _recorded(tmp_path / "alone"), _recorded(tmp_path / "data")
    first, second = sorted(data.glob("*.mcap"))
    second.unlink()
    shutil.copy(first, data / "shard-rec0-00009.mcap")
    (data / "shard-rec0-00010.mcap.part").touch()
    outcome = compare([alone], [data], validate(data))
    assert (outcome.missing, outcome.double, outcome.wrong) == ([1, 3], [0, 2], [])
    assert "shard-rec0-00010.mcap.part" in outcome.torn
    longer = _recorded(tmp_path / "longer", wanted=5)
    assert compare([alone], [longer], validate(longer)).wrong == [4]


def test_numbers_that_mean_nothing_are_refused() -> None:
    with pytest.raises(ConfigError, match="--episodes must be at least 1"):
        bench_chaos(BenchChaosOptions(episodes=0))


def test_small_disk_is_small_or_absent(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", 1) as mounted:
        if mounted:
            assert shutil.disk_usage(tmp_path / "disk").total == 2**20
    assert not (tmp_path / "disk").is_mount()


@linux
@pytest.mark.slow
def test_run_among_faults_is_the_run_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench_chaos(BenchChaosOptions(episodes=4, faults=14, workers=2, longest_s=1.0, folder=tmp_path, json=True))
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["ok"]
    assert result["set_aside"] == {}
    assert result["faults"] >= 10, result["skipped"]
    assert result["believed"] == []
