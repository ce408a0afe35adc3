"""Fixtures shared by all tests."""

import json
import os
import re
from collections.abc import Callable, Generator
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from readygo.common.arrays import UInt8Array
from readygo.common.files import cache_root
from readygo.common.scenes.embedded import ensure_embedded_scene
from tests.collection import TurnedFolder, garbage_left_alone, sort_by_file
from tests.durations import Durations, load_durations, sort_longest_first

GOLDEN = Path(__file__).resolve().parent / "golden"
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
# Machine code is kept in one place, also by tests that move the cache and by the processes that they start.
os.environ.setdefault("NUMBA_CACHE_DIR", str(cache_root() / "kernels"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real scenes, maps, mocap and avatars; tests that need it skip where it is absent."""
    if not SHARED.is_dir():
        pytest.skip("the real scenes and avatars (../shared/data) are not on this machine")
    return SHARED


@pytest.fixture(scope="session")
def embedded_bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the embedded scene, made once for all workers of this run; tests leave it as it is."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    return ensure_embedded_scene(folder / "embedded").path


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-golden", action="store_true", help="rewrite tests/golden from what the code makes now")
    parser.addoption("--update-durations", action="store_true", help="store how long each test file takes")
    parser.addoption("--fuzz", type=int, default=20_000, help="inputs that the message decoders are tried with")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--update-durations") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Durations())


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    with garbage_left_alone():
        return (yield)


def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Dir | None:
    return TurnedFolder.from_parent(parent, path=path) if hasattr(parent.config, "workerinput") else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if hasattr(config, "workerinput"):
        sort_by_file(items)
        sort_longest_first(items, load_durations())


@pytest.fixture
def golden_image(request: pytest.FixtureRequest) -> Callable[[str, UInt8Array], None]:
    """Compares an RGB image with `tests/golden/NAME.png`; up to 2 of 255 may differ per channel."""

    def compare(name: str, rgb: UInt8Array) -> None:
        import cv2

        path = GOLDEN / f"{name}.png"
        if request.config.getoption("--update-golden"):
            cv2.imwrite(str(path), rgb[..., ::-1])
        stored = cv2.imread(str(path))
        assert stored is not None, f"{path.name} is missing: run `make golden` and look at it"
        difference = np.abs(stored[..., ::-1].astype(np.int16) - rgb)
        assert difference.max() <= 2, f"{path.name} differs in {np.mean(difference.max(axis=2) > 2):.1%} of its pixels"

    return compare


@pytest.fixture
def golden_page(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """Compares a page, a chart or a table with `tests/golden/pages/NAME.txt`, but for its style and its images."""

    def compare(name: str, text: str) -> None:
        plain = re.sub(r"<style>.*?</style>", "", text, flags=re.DOTALL)
        plain = re.sub(r"(data:[a-z/]+;base64,)[A-Za-z0-9+/=]+", r"\1", plain)
        lines = plain.replace("><", ">\n<")
        path = GOLDEN / "pages" / f"{name}.txt"
        if request.config.getoption("--update-golden"):
            path.parent.mkdir(exist_ok=True)
            path.write_text(lines)
        assert lines == path.read_text(), f"{path.name} changed: if that is right, run `make golden` and look at it"

    return compare


@pytest.fixture
def golden_figures(request: pytest.FixtureRequest) -> Callable[..., None]:
    """Compares rows of numbers with figures in `tests/golden/figures`: what a seed gives stays the same.

    The figures are the number of rows and sums of cosines of four directions in the space of the rows, so that no
    change of a row hides behind that of another one. Call it as `golden_figures("file/name", *columns)`.
    """

    def compare(name: str, *columns: npt.ArrayLike, scale: float = 3.0) -> None:
        parts = [np.asarray(column, np.float64) for column in columns]
        rows = np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)
        directions = scale * np.sin(1.0 + np.arange(4 * rows.shape[1]) ** 1.5).reshape(-1, 4)
        figures = [len(rows), *np.cos(rows @ directions).sum(axis=0).round(6).tolist()]
        file, key = name.split("/", 1)
        path = GOLDEN / "figures" / f"{file}.json"
        stored = json.loads(path.read_text()) if path.is_file() else {}
        if request.config.getoption("--update-golden"):
            stored[key] = figures
            path.parent.mkdir(exist_ok=True)
            path.write_text(json.dumps(dict(sorted(stored.items())), indent=1) + "\n")
        assert key in stored, f"{name} is missing: run `make golden`"
        assert figures == pytest.approx(stored[key], rel=0.0, abs=1e-6 * len(rows) + 1e-5), f"{name} has changed"

    return compare
