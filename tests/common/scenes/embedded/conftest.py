import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from readygo.common.gaussians import GaussianCloud
from readygo.common.scenes import Scene
from readygo.common.scenes.embedded import bundle, embedded_scene_cloud, ensure_embedded_scene


@pytest.fixture(scope="session")
def cloud() -> GaussianCloud:
    return embedded_scene_cloud()


@pytest.fixture(scope="session")
def made(cloud: GaussianCloud, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    patch = pytest.MonkeyPatch()
    patch.setattr(bundle, "embedded_scene_cloud", lambda seed: cloud)
    scene = ensure_embedded_scene(tmp_path_factory.mktemp("scenes") / "embedded")
    patch.undo()
    return scene


@pytest.fixture
def golden_figures(request: pytest.FixtureRequest) -> Callable[..., None]:
    """Compares rows of numbers with figures in `tests/golden/embedded_figures.json`: every number counts.

    A flat is part of what a dataset was made in. The figures are the number of rows and sums of cosines of four
    directions in the space of the rows, so that no change of a row hides behind that of another one.
    """
    path = Path(__file__).parents[3] / "golden" / "embedded_figures.json"

    def compare(name: str, *columns: npt.ArrayLike) -> None:
        parts = [np.asarray(column, np.float64) for column in columns]
        rows = np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)
        directions = 3.0 * np.sin(1.0 + np.arange(4 * rows.shape[1]) ** 1.5).reshape(-1, 4)
        figures = [len(rows), *np.cos(rows @ directions).sum(axis=0).round(6).tolist()]
        stored = json.loads(path.read_text()) if path.is_file() else {}
        if request.config.getoption("--update-golden"):
            stored[name] = figures
            path.write_text(json.dumps(dict(sorted(stored.items())), indent=1) + "\n")
        assert figures == pytest.approx(stored[name], rel=0.0, abs=1e-6 * len(rows) + 1e-5), f"{name} has changed"

    return compare
