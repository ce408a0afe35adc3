"""What is built of the checkout: one top-level name, complete, that works beside packages of other people."""

import os
import re
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

import readygo
from tests.common.dataset.episodes import write_shard

ROOT = Path(__file__).resolve().parents[2]
TOPS = ("apps", "benchmarks", "common", "runs", "services")
SHIPPED = {".css", ".html", ".json", ".md", ".npz", ".proto", ".py", ".pyi", ".toml"}
# Of somebody who uses readygo from a project with packages of the same names as the folders of ours.
JOB = """
import sys
before = list(sys.path)
import apps, benchmarks, common, runs, services
import readygo
from readygo import Dataset, load_avatars
for name in readygo.__all__:
    getattr(readygo, name)
assert {module.OWNER for module in (apps, benchmarks, common, runs, services)} == {"them"}
assert sys.path == before
print(len(Dataset("data")), *load_avatars())
print(readygo.__file__)
"""
# What docs/own-policy.md shows, in a process that knows of no environment before.
GYMNASIUM = next(
    example
    for example in re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "own-policy.md").read_text(), re.DOTALL)
    if "gymnasium" in example
)
FLEET = """
import time
from pathlib import Path
from readygo.apps.fleet.fleet import Fleet
fleet = Fleet(connect="tcp/127.0.0.1:1", run="run", data=Path("data").resolve(), logs=Path("."))
fleet.add("renderer", "renderer0")
log, deadline_s = Path("renderer0.log"), time.monotonic() + 60
while not (log.exists() and "\\n" in log.read_text()) and time.monotonic() < deadline_s:
    time.sleep(0.1)
print(log.read_text())
fleet.stop()
"""


def _run(*command: object, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    known = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    words = [str(word) for word in command]
    done = subprocess.run(words, cwd=cwd, env=known | environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the wheel and the sdist."""
    folder = tmp_path_factory.mktemp("built")
    _run(sys.executable, "-m", "hatchling", "build", "-d", folder, cwd=ROOT)
    return folder


@pytest.fixture
def wheel(built: Path) -> Path:
    return next(built.glob("*.whl"))


@pytest.fixture
def environment(tmp_path: Path) -> Path:
    """A fresh environment that sees the packages of this one, but for readygo: it reads no .pth file of theirs."""
    folder = tmp_path / "environment"
    venv.create(folder, with_pip=False)
    site_packages = next(folder.glob("lib/python*/site-packages"))
    theirs = [path for path in sys.path if path.endswith("site-packages")]
    (site_packages / "theirs.pth").write_text("\n".join(theirs) + "\n")
    return folder


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A folder of somebody who has packages of the same names as the folders of ours."""
    folder = tmp_path / "project"
    for top in TOPS:
        (folder / top).mkdir(parents=True)
        (folder / top / "__init__.py").write_text('OWNER = "them"\n')
    write_shard(folder / "data", [0, 1])
    return folder


def _install(environment: Path, *what: object) -> str:
    """Install into an environment; returns what pip says. The settings of the machine's pip are left out."""
    pip = (sys.executable, "-m", "pip", "--python", environment / "bin" / "python", "install", "--quiet")
    options = ("--no-deps", "--no-index", "--no-build-isolation", "--disable-pip-version-check")
    done = _run(*pip, *options, *what, cwd=environment, PIP_CONFIG_FILE=os.devnull)
    return done.stdout + done.stderr


def _tree() -> set[str]:
    """Every file of the checkout that a wheel shall hold."""
    files = [path for top in TOPS for path in (ROOT / top).rglob("*") if path.suffix in SHIPPED]
    left_out = {"results", "README.md"}
    names = {"readygo/" + path.relative_to(ROOT).as_posix() for path in files if not left_out & set(path.parts)}
    own = {f"readygo/{path.name}" for path in (ROOT / "readygo").iterdir() if path.suffix in SHIPPED}
    return names | own | {"readygo/py.typed"}


@pytest.mark.slow
def test_wheel_adds_one_name_and_holds_the_whole_tree(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    info = f"readygo-{readygo.__version__}.dist-info"
    assert {name.split("/")[0] for name in names} == {"readygo", info}
    assert {name for name in names if name.startswith("readygo/")} == _tree()
    assert "readygo/common/avatars/data/amara.npz" in names
    assert f"{info}/licenses/LICENSE" in names


@pytest.mark.slow
def test_sdist_holds_what_the_wheel_holds(built: Path, wheel: Path) -> None:
    with tarfile.open(next(built.glob("*.tar.gz"))) as sdist:
        members = {member.name.partition("/")[2]: member for member in sdist.getmembers()}
    assert {name for name in members if name.startswith("readygo/")} == _tree()
    assert all(member.isreg() for member in members.values())
    assert {"LICENSE", "README.md", "pyproject.toml"} <= set(members)


@pytest.mark.slow
def test_metadata_says_license_and_authors(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    text = archive.read(next(name for name in archive.namelist() if name.endswith("/METADATA"))).decode()
    for line in (f"Version: {readygo.__version__}", "License-Expression: Apache-2.0", "Author: the readygo authors"):
        assert f"\n{line}\n" in text


@pytest.mark.slow
def test_wheel_works_beside_packages_of_the_same_names(wheel: Path, environment: Path, project: Path) -> None:
    _install(environment, wheel)
    (project / "job.py").write_text(JOB)
    said = _run(environment / "bin" / "python", "job.py", cwd=project).stdout.splitlines()
    assert said[0] == "24 amara bruno clara dae elif femi gil hana"
    assert Path(said[1]).is_relative_to(environment)
    command = environment / "bin" / "readygo"
    assert _run(command, "--version", cwd=project).stdout == f"readygo {readygo.__version__}\n"
    assert "is sound: 2 episodes, 24 samples" in _run(command, "validate", "data", cwd=project).stdout
    assert "elif" in _run(command, "avatar", "list", cwd=project).stdout
    _run(command, "coverage", "data", "--out", "page", cwd=project)
    assert "</html>" in (project / "page" / "coverage.html").read_text()
    pytest.importorskip("gymnasium", reason="gymnasium (extra gym) is not installed")
    for example in (GYMNASIUM, GYMNASIUM.replace("readygo.gym:", "readygo:")):
        (project / "environments.py").write_text(example)
        _run(environment / "bin" / "python", "-W", "error", "environments.py", cwd=project)


@pytest.mark.slow
def test_processes_of_a_fleet_are_those_of_the_wheel(wheel: Path, environment: Path, project: Path) -> None:
    _install(environment, wheel)
    for top in TOPS:
        (project / top / "__init__.py").write_text("raise RuntimeError('a package of theirs is imported')\n")
    said = _run(environment / "bin" / "python", "-c", FLEET, cwd=project).stdout
    assert "No router answers at tcp/127.0.0.1:1" in said.splitlines()[0]


@pytest.mark.slow
def test_editable_install_warns_of_nothing_and_adds_one_name(environment: Path, project: Path) -> None:
    assert _install(environment, "--editable", ROOT) == ""
    code = "import readygo, sys; print(readygo.__file__); print([p for p in sys.path if p == sys.argv[1]])"
    said = _run(environment / "bin" / "python", "-c", code, ROOT, cwd=project).stdout.splitlines()
    assert said == [str(ROOT / "readygo" / "__init__.py"), "[]"]
    (project / "job.py").write_text(JOB)
    _run(environment / "bin" / "python", "job.py", cwd=project)


def test_every_package_has_an_init_file() -> None:
    folders = {path.parent for top in TOPS for path in (ROOT / top).rglob("*.py")}
    assert [folder for folder in sorted(folders) if not (folder / "__init__.py").exists()] == []
