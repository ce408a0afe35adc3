import json
import socket
import subprocess
import sys

from readygo.services.trainer.ranks import Ranks

TOGETHER = """
import json, sys
from pathlib import Path
from readygo.services.trainer.ranks import Ranks, join_ranks, leave_ranks
from readygo.services.trainer.train import train_policy
from tests.services.trainer.conftest import make_source, quick
join_ranks("cpu")
config = quick(samples=64, batch_size=16)
metrics = train_policy(make_source(), config, Path(sys.argv[1]) / str(Ranks().rank))
print(json.dumps(metrics))
leave_ranks()
"""


def test_alone_there_is_one_process_that_does_everything():
    ranks, network = Ranks(), object()
    assert (ranks.rank, ranks.count, ranks.is_first) == (0, 1, True)
    assert ranks.wrap(network) is network
    assert ranks.broadcast(0.25) == 0.25


def test_two_processes_train_one_policy(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    shared = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port), "WORLD_SIZE": "2"}
    processes = [
        subprocess.Popen(
            [
                "env",
                *(f"{k}={v}" for k, v in (shared | {"RANK": str(rank)}).items()),
                sys.executable,
                "-c",
                TOGETHER,
                str(tmp_path),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for rank in range(2)
    ]
    outputs = [process.communicate(timeout=120) for process in processes]
    assert [process.returncode for process in processes] == [0, 0], outputs[0][1][-500:]
    first, second = (json.loads(output[0].splitlines()[-1]) for output in outputs)
    assert first["samples_seen"] == 64
    assert first["steps"] == 2
    assert second == {}
    assert (tmp_path / "0" / "policy.toml").is_file()
    assert not (tmp_path / "1" / "policy.toml").exists()
