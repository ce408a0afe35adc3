from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.apps.learn import reinforcement as module
from readygo.common.errors import RunError


def test_failure_of_the_policy_on_states_at_the_end_ends_the_run(tmp_path: Path) -> None:
    log = tmp_path / "rl.log"
    log.touch()
    running = SimpleNamespace(poll=lambda: None, wait=lambda: -9)
    module._check_policy(running, log)  # type: ignore[arg-type]
    with pytest.raises(RunError, match=r"exit code -9, .*rl\.log\): no message$"):
        module._check_policy(running, log, wait=True)  # type: ignore[arg-type]
