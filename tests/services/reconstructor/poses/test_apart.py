import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from readygo.common.errors import RunError, SceneError
from readygo.services.reconstructor.poses.apart import apart


def _die(words: str) -> None:
    os.write(2, words.encode())
    os.abort()


def _refuse(path: Path) -> None:
    raise SceneError(f"{path} is no model")


def test_what_a_call_returns_and_raises_is_passed_on() -> None:
    assert apart(os.path.join, "a", "b") == "a/b"
    with pytest.raises(SceneError, match="a is no model"):
        apart(_refuse, Path("a"))


def test_process_that_is_ended_is_an_error_with_its_first_words() -> None:
    with pytest.raises(RunError, match=r"_die ended the process .*SIGABRT.*: disk I/O error\. Make room"):
        apart(_die, "disk I/O error\n@ 0x7fd5373e8a48\n")


def _blocked() -> bool:
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, set())


def _interrupt_both() -> None:
    os.kill(os.getppid(), signal.SIGINT)
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(60)


@pytest.fixture
def hears_ctrl_c() -> Iterator[None]:
    """A shell starts what runs in its background deaf to Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("hears_ctrl_c")
def test_ctrl_c_is_heard_by_who_asked_alone(capfd: pytest.CaptureFixture[str]) -> None:
    assert apart(_blocked)
    assert not _blocked()
    with pytest.raises(KeyboardInterrupt):
        apart(_interrupt_both)
    assert capfd.readouterr().err == ""
