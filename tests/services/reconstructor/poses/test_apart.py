import os
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
