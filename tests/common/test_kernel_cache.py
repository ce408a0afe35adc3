import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from readygo.common import files, kernel_cache
from readygo.common.kernel_cache import KernelCache
from readygo.common.kernels import kernel_with_cache

COMMON = Path(kernel_cache.__file__).resolve().parent
CALLER = """
from readygo.callee import callee
from readygo.common.kernels import kernel_with_cache
from readygo.pair import Pair

@kernel_with_cache
def caller(pair):
    return callee(pair.first)

print(caller(Pair(1.0, 5.0)), sum(caller.stats.cache_hits.values()))
"""
CALLEE = """
from readygo.common.kernels import {decorator}
from readygo.constants import STEP

@{decorator}
def callee(x):
    return x + STEP
"""
PAIR = """
from typing import NamedTuple

class Pair(NamedTuple):
    first: float
    second: float
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package `readygo` of two kernels, a constant and the class of an argument, each in a file of its own."""
    root = tmp_path / "tree" / "readygo"
    (root / "common").mkdir(parents=True)
    for name in ("kernels.py", "kernel_cache.py", "kernel_digest.py", "files.py", "errors.py"):
        shutil.copy(COMMON / name, root / "common")
    for name in ("__init__.py", "common/__init__.py"):
        (root / name).write_text("")
    (root / "caller.py").write_text(CALLER)
    (root / "callee.py").write_text(CALLEE.format(decorator="kernel_with_cache"))
    (root / "constants.py").write_text("STEP = 1.0\n")
    (root / "pair.py").write_text(PAIR)
    return root


def run(package: Path, code: str = "import readygo.caller", **environment: str) -> subprocess.CompletedProcess[str]:
    variables = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    cache = {"XDG_CACHE_HOME": str(package.parents[1] / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=package.parent,
        env=variables | cache | environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_changed_callee_constant_or_argument_class_in_another_file_is_compiled_again(package: Path) -> None:
    assert run(package).stdout == "2.0 0\n"
    assert run(package).stdout == "2.0 1\n"
    (package / "constants.py").write_text("STEP = 2.0\n")
    assert run(package).stdout == "3.0 0\n"
    (package / "callee.py").write_text(CALLEE.format(decorator="inline_kernel").replace("x + STEP", "x - STEP"))
    assert run(package).stdout == "-1.0 0\n"
    (package / "constants.py").write_text("STEP = 3.0\n")
    assert run(package).stdout == "-2.0 0\n"
    (package / "pair.py").write_text(PAIR.replace("first", "_").replace("second", "first").replace("_", "second"))
    assert run(package).stdout == "2.0 0\n"


def test_edit_that_no_kernel_refers_to_leaves_kernels_as_they_are(package: Path) -> None:
    run(package)
    errors = package / "common" / "errors.py"
    errors.write_text(f"{errors.read_text()}# Edited.\n")
    (package / "constants.py").write_text("OTHER = 7.0\n\nSTEP = 1.0\n")
    assert run(package).stdout == "2.0 1\n"


def test_kernels_lie_in_readygos_own_folder(package: Path) -> None:
    run(package)
    folder = package.parents[1] / "cache" / "readygo" / "kernels"
    assert sorted(path.name for path in folder.iterdir()) == ["readygo.callee", "readygo.caller"]
    assert [path.name.partition("-")[0] for path in (folder / "readygo.caller").iterdir()] == ["caller"]


def square(x: float) -> float:
    return x * x


@pytest.fixture
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(kernel_cache._settings, "CACHE_DIR", str(tmp_path))
    return tmp_path / __name__


def test_only_files_used_last_are_kept(own_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "_KEPT", 2)
    own_folder.mkdir()
    old, used, other = (own_folder / f"{name}.code" for name in ("square-old", "square-used", "square_root-old"))
    for age, path in enumerate((used, old, other)):
        path.touch()
        os.utime(path, (1e9 - age, 1e9 - age))
    kernel_with_cache(square)(2.0)
    left = set(own_folder.iterdir())
    assert {used, other} < left
    assert old not in left
    assert len(left) == 3


def test_damaged_file_is_compiled_again(own_folder: Path) -> None:
    kernel_with_cache(square)(2.0)
    (path,) = own_folder.iterdir()
    whole = path.read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"no pickle"):
        path.write_bytes(damaged)
        assert kernel_with_cache(square)(3.0) == 9.0
    assert len(path.read_bytes()) > len(whole) // 2


def test_types_processors_and_entries_for_python_have_files_of_their_own() -> None:
    class Codegen:
        def __init__(self, cpu: str) -> None:
            self.magic_tuple = lambda: ("x86_64", cpu, "+avx2")

    from numba import float32, float64

    cache = KernelCache(kernel_with_cache(square))
    paths = {
        cache._path((kind,), Codegen(cpu), entry=entry)
        for kind in (float32, float64)
        for cpu in ("skylake", "znver3")
        for entry in (False, True)
    }
    assert len(paths) == 8


def test_numbas_own_folder_is_taken_where_it_is_named(package: Path, tmp_path: Path) -> None:
    run(package, NUMBA_CACHE_DIR=str(tmp_path / "named"))
    assert (tmp_path / "named" / "readygo.caller").is_dir()
    assert not (package.parents[1] / "cache").exists()


def test_folder_that_cannot_be_written_stops_the_first_kernel_and_nothing_else(package: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    there = str(tmp_path / "file")
    assert run(package, "import readygo.callee", XDG_CACHE_HOME=there).returncode == 0
    error = run(package, XDG_CACHE_HOME=there).stderr.splitlines()[-1]
    assert error.startswith(
        f"readygo.common.errors.ReadygoError: The cache folder {there}/readygo/kernels/readygo.call"
    )
    assert error.endswith("set XDG_CACHE_HOME to a folder that can be written.")


def test_folder_is_the_one_of_the_import(package: Path, tmp_path: Path) -> None:
    moved = f"import os, readygo.callee as c; os.environ['XDG_CACHE_HOME'] = {str(tmp_path / 'other')!r}; c.callee(1.0)"
    assert run(package, moved).returncode == 0
    assert not (tmp_path / "other").exists()


def test_cache_folder_that_cannot_be_made_names_the_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(files.ReadygoError, match=r"Not a directory.*set XDG_CACHE_HOME"):
        files.cache_folder("scenes")
