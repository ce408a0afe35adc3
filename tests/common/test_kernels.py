import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from readygo.common import files, kernels

COMMON = Path(kernels.__file__).resolve().parent
CALLER = """
from readygo.callee import callee
from readygo.common.kernels import compiled

@compiled
def caller(x):
    return callee(x)

print(caller(1.0), sum(caller.stats.cache_hits.values()))
"""
CALLEE = """
from readygo.common.kernels import compiled
from readygo.constants import STEP

@compiled
def callee(x):
    return x + STEP
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package `readygo` of two kernels and a constant, each in a file of its own."""
    root = tmp_path / "tree" / "readygo"
    (root / "common").mkdir(parents=True)
    for name in ("kernels.py", "files.py", "errors.py"):
        shutil.copy(COMMON / name, root / "common")
    for name in ("__init__.py", "common/__init__.py"):
        (root / name).write_text("")
    (root / "caller.py").write_text(CALLER)
    (root / "callee.py").write_text(CALLEE)
    (root / "constants.py").write_text("STEP = 1.0\n")
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


def test_changed_callee_or_constant_in_another_file_is_compiled_anew(package: Path) -> None:
    assert run(package).stdout == "2.0 0\n"
    assert run(package).stdout == "2.0 1\n"
    (package / "constants.py").write_text("STEP = 2.0\n")
    assert run(package).stdout == "3.0 0\n"
    (package / "callee.py").write_text(CALLEE.replace("x + STEP", "x - STEP"))
    assert run(package).stdout == "-1.0 0\n"


def test_file_that_no_kernel_imports_leaves_kernels_as_they_are(package: Path) -> None:
    run(package)
    (package / "other.py").write_text("import readygo.caller\n")
    assert run(package).stdout == "2.0 1\n"


def test_kernels_lie_in_readygos_own_folder_and_old_states_are_forgotten(package: Path) -> None:
    for step in range(6):
        (package / "constants.py").write_text(f"STEP = {step}.0\n")
        run(package)
    folder = package.parents[1] / "cache" / "readygo" / "kernels"
    assert sorted(path.name for path in folder.iterdir()) == ["readygo.callee", "readygo.caller"]
    assert len(list((folder / "readygo.caller").iterdir())) == kernels._STATES_KEPT


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


def test_functions_of_others_keep_numbas_cache() -> None:
    @numba.njit(cache=True)
    def theirs(x: float) -> float:
        return x

    assert type(theirs._cache) is not kernels._KernelCache
    assert type(kernels.compiled(theirs.py_func)._cache) is kernels._KernelCache


def test_flags_are_those_of_njit() -> None:
    @kernels.compiled(error_model="numpy")
    def quotient(x: float, y: float) -> float:
        return x / y

    @kernels.compiled
    def checked_quotient(x: float, y: float) -> float:
        return x / y

    assert quotient(1.0, 0.0) == float("inf")
    with pytest.raises(ZeroDivisionError):
        checked_quotient(1.0, 0.0)


def test_cache_folder_that_cannot_be_made_names_the_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(files.ReadygoError, match=r"Not a directory.*set XDG_CACHE_HOME"):
        files.cache_folder("scenes")


def test_what_a_package_loads_lazily_is_imported_by_whoever_imports_the_package() -> None:
    root = Path(kernels.__file__).parents[1]
    found = kernels._with_imports(root / "services" / "driver" / "risks.py")
    assert root / "common" / "episode" / "__init__.py" in found
    assert root / "common" / "episode" / "collision.py" in found
