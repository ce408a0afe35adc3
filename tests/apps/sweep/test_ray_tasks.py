"""Points as tasks of Ray: on a local cluster of two nodes, one of which dies; and what is said without a cluster."""

import builtins
import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from readygo.apps.commands.sweep import SweepOptions, sweep
from readygo.apps.sweep import ray_tasks
from readygo.apps.sweep.folder import SweepFolder
from readygo.apps.sweep.plan import PointNeeds
from readygo.apps.sweep.ray_tasks import import_ray, run_command, run_on_ray
from readygo.common.errors import ConfigError, RunError
from readygo.common.extras import is_installed
from tests.apps.sweep.sweeps import LONGER, read_sweep, records_of, write_sweep

needs_ray = pytest.mark.skipif(not is_installed("ray"), reason="ray (extra ray) is not installed")


@pytest.fixture
def cluster() -> Iterator[Any]:
    """Two nodes of one core each on this machine, and a head without cores."""
    from ray.cluster_utils import Cluster

    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "object_store_memory": 80_000_000})
    yield made
    made.shutdown()


def _add_nodes(cluster: Any) -> list[Any]:
    nodes = [cluster.add_node(num_cpus=1, object_store_memory=80_000_000) for _ in range(2)]
    cluster.wait_for_nodes()
    return nodes


@needs_ray
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_sweep_among_two_nodes_of_which_one_dies_has_the_same_records(tmp_path: Path, cluster: Any) -> None:
    nodes = _add_nodes(cluster)
    path, out = write_sweep(tmp_path, LONGER), tmp_path / "ray"
    begun = out / ".sweep" / "points" / "calm" / "embedded" / "1.json"

    def kill() -> None:
        while not begun.exists():
            time.sleep(0.05)
        time.sleep(2.0)
        cluster.remove_node(nodes[1], allow_graceful=False)

    killer = threading.Thread(target=kill)
    killer.start()
    sweep(SweepOptions(sweep=path, out=out, on="ray", ray_address=cluster.address))
    killer.join()
    sweep(SweepOptions(sweep=path, out=tmp_path / "here"))
    assert records_of(out) == records_of(tmp_path / "here")
    attempts = [point["attempts"] for point in json.loads((out / "sweep.json").read_text())["points"]]
    assert sum(attempts) > len(attempts)


def test_node_that_does_not_see_the_folder_is_named(tmp_path: Path) -> None:
    host = run_command(["true"], str(tmp_path / "log"), str(tmp_path), str(tmp_path / "token"))
    assert host == ray_tasks.socket.gethostname()
    assert not (tmp_path / "log").exists()
    (tmp_path / "token").touch()
    assert run_command(["true"], str(tmp_path / "log"), str(tmp_path / "nothing"), str(tmp_path / "token")) == host
    assert run_command(["echo", "x"], str(tmp_path / "log"), str(tmp_path), str(tmp_path / "token")) == ""
    assert (tmp_path / "log").read_text() == "x\n"


class Ray:
    """As much of Ray as tasks need; every task has the same answer."""

    class exceptions:  # noqa: N801
        class RayError(Exception):
            pass

    def __init__(self, answer: Any) -> None:
        self.answer, self.asked, self.most = answer, list[tuple[Any, ...]](), 0

    def init(self, address: str, **_: Any) -> None:
        self.address = address
        if address == "nowhere":
            raise ConnectionError("Could not find\nany running Ray instance.")

    def shutdown(self) -> None:
        self.address = ""

    def remote(self, **settings: Any) -> Any:
        self.settings = settings
        return lambda function: SimpleNamespace(remote=self._ask)

    def _ask(self, *words: Any) -> int:
        self.asked.append(words)
        return len(self.asked)

    def wait(self, running: list[Any], num_returns: int) -> tuple[list[Any], list[Any]]:
        self.most = max(self.most, len(running))
        return running[:1], running[1:]

    def get(self, task: str) -> Any:
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


def _run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, answer: Any, **given: Any) -> tuple[Any, list[str]]:
    ray, ended = Ray(answer), list[str]()
    monkeypatch.setattr(ray_tasks, "import_ray", lambda: ray)
    plan, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    settings = {
        "address": "auto",
        "workers": 0,
        "needs": PointNeeds(cpus=2, gpus=1),
        "ended": lambda point: ended.append(point.name),
        **given,
    }
    try:
        run_on_ray(folder, plan, plan.points[:3], **settings)
    finally:
        # Without a cluster nothing is written.
        assert folder.path.exists() == bool(ray.asked)
        assert not list(folder.state.glob("token-*"))
    return ray, ended


def test_tasks_reserve_cores_and_are_told_the_token(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    ray, ended = _run(monkeypatch, tmp_path, "")
    assert ray.settings == {"num_cpus": 2, "num_gpus": 1, "max_retries": 3}
    assert ray.most == 3
    assert ended == ["calm/embedded/0", "calm/embedded/1", "calm/embedded-1/0"]
    command, log, cwd, token = ray.asked[0]
    assert command[-2:] == ["--point", "0"]
    assert (Path(log).name, cwd, Path(token).parent.name) == ("0.log", str(Path.cwd()), ".sweep")
    assert ray.address == ""
    assert _run(monkeypatch, tmp_path, "", workers=2)[0].most == 2


@pytest.mark.parametrize(
    ("answer", "given", "words"),
    [
        ("node7", {}, "The node node7 does not see .*out: --out must be on a file system that all nodes share"),
        (Ray.exceptions.RayError("It died.\nmore"), {}, "Ray cannot run the point calm/embedded/0: It died.$"),
        ("", {"address": "127.0.0.1:1"}, "No Ray cluster answers at '127.0.0.1:1': .*Connection refused"),
        ("", {"address": "nowhere"}, "No Ray cluster answers at 'nowhere': Could not find any running Ray instance"),
    ],
)
def test_what_ray_cannot_do_is_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, answer: Any, given: dict[str, Any], words: str
) -> None:
    with pytest.raises(RunError, match=words):
        _run(monkeypatch, tmp_path, answer, **given)


def test_missing_ray_is_named_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.partition(".")[0] == "ray":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ConfigError, match=r"--on ray needs ray; run: .*\[ray\]"):
        import_ray()
