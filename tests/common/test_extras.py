import importlib.metadata
import shlex
import sys
from pathlib import Path

import pytest

from readygo.common import extras
from readygo.common.extras import install_command


def test_in_a_checkout_the_extra_is_installed_from_there_with_the_pinned_versions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "my robots"
    root.mkdir()
    (root / "pyproject.toml").touch()
    monkeypatch.setattr(extras, "ROOT", root)
    words = [sys.executable, "-m", "pip", "install", "-e", f"{root}[train]", "-c", f"{root}/constraints.txt"]
    assert shlex.split(install_command("train")) == words


def test_of_a_wheel_the_extras_packages_are_named_and_never_readygo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = ["numpy>=2.0", "torch>=2.6; extra == 'train'", 'triton>=3; platform_system == "Linux" and extra == "gpu"']
    monkeypatch.setattr(extras, "ROOT", tmp_path)
    monkeypatch.setattr(importlib.metadata, "requires", lambda name: lines)
    assert shlex.split(install_command("train"))[4:] == ["torch>=2.6"]
    assert shlex.split(install_command("gpu"))[4:] == ["triton>=3"]


def test_checkout_has_what_the_command_names() -> None:
    assert (extras.ROOT / "pyproject.toml").is_file()
    assert (extras.ROOT / "constraints.txt").is_file()


def test_wheel_without_requirements_names_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "ROOT", tmp_path)
    monkeypatch.setattr(importlib.metadata, "requires", lambda name: None)
    assert shlex.split(install_command("train")) == [sys.executable, "-m", "pip", "install"]
