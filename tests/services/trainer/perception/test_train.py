import json
from pathlib import Path

import numpy as np
import pytest
import torch

from readygo.common.camera.config import CameraConfig
from readygo.common.errors import PolicyError
from readygo.common.perception import PerceptionSpec
from readygo.common.robot import RobotConfig
from readygo.services.trainer.checkpoint import read_state, write_state
from readygo.services.trainer.config import CHECKPOINT_FILE
from readygo.services.trainer.perception.config import PerceptionConfig
from readygo.services.trainer.perception.looks import Looks
from readygo.services.trainer.perception.train import METRICS_FILE, PerceptionRun, _moving_averages, perceive
from tests.services.trainer.perception.conftest import ROBOT, make_looks

SPEC = PerceptionSpec(robot=ROBOT)
SMALL = {"threads": 1, "widths": (8, 12, 16, 16, 32), "batch_size": 16, "precision": "fp32"}


def config(samples: int, **settings: object) -> PerceptionConfig:
    return PerceptionConfig(samples=samples, **{**SMALL, **settings})  # type: ignore[arg-type]


def weights(run: PerceptionRun) -> np.ndarray:
    return np.concatenate([p.detach().numpy().ravel() for p in run.averaged.module.parameters()])


def test_training_finds_posts_and_writes_what_runs(tmp_path: Path) -> None:
    looks = make_looks(240, episodes=12)
    metrics = PerceptionRun(looks, SPEC, config(4000, learning_rate=4e-3), tmp_path, {"data": "x"}).go()
    told = metrics["held_out"]
    assert told["bearing_deg"] < 4.0
    assert told["distance"] < 0.25
    assert told["missed"] < 0.4
    assert (tmp_path / METRICS_FILE).read_text() == json.dumps(metrics, indent=2)
    assert (tmp_path / "perception.onnx").stat().st_size > 1000


def test_training_finds_posts_in_images_of_other_widths(tmp_path: Path) -> None:
    camera = CameraConfig(height_px=24, width_px=56)
    looks, spec = make_looks(240, episodes=12, camera=camera), PerceptionSpec(robot=RobotConfig(camera=camera))
    told = PerceptionRun(looks, spec, config(4000, learning_rate=4e-3), tmp_path, {"data": "x"}).go()["held_out"]
    assert told["bearing_deg"] < 4.0
    assert told["missed"] < 0.4


def test_run_that_was_cut_off_goes_on_where_it_was(tmp_path: Path, looks: Looks) -> None:
    whole = PerceptionRun(looks, SPEC, config(160), tmp_path / "whole", {"data": "x"})
    whole.go()
    first = PerceptionRun(looks, SPEC, config(160), tmp_path / "cut", {"data": "x"})
    for _ in range(4):
        first.step()
    first.save()
    second = PerceptionRun(looks, SPEC, config(160), tmp_path / "cut", {"data": "x"})
    assert second.samples_seen == 64
    second.go()
    np.testing.assert_array_equal(weights(whole), weights(second))


def test_folder_of_other_data_or_settings_is_refused(tmp_path: Path, looks: Looks) -> None:
    PerceptionRun(looks, SPEC, config(16), tmp_path, {"data": "x"}).save()
    with pytest.raises(PolicyError, match="another data"):
        PerceptionRun(looks, SPEC, config(16), tmp_path, {"data": "y"})
    with pytest.raises(PolicyError, match="another learning_rate"):
        PerceptionRun(looks, SPEC, config(16, learning_rate=1e-4), tmp_path, {"data": "x"})
    PerceptionRun(looks, SPEC, config(999), tmp_path, {"data": "x"})


def test_training_begins_with_the_weights_of_trained_perception(tmp_path: Path, looks: Looks) -> None:
    trained = PerceptionRun(looks, SPEC, config(64), tmp_path / "trained", {"data": "x"})
    trained.go()
    begun = PerceptionRun(looks, SPEC, config(64, perception=str(tmp_path / "trained")), tmp_path / "on", {"data": "y"})
    np.testing.assert_array_equal(weights(trained), weights(begun))
    assert begun.samples_seen == 0
    begun.go()
    assert not np.array_equal(weights(trained), weights(begun))
    # It resumes wherever the folder is, but with these weights only.
    (tmp_path / "trained").rename(tmp_path / "moved")
    moved = config(64, perception=str(tmp_path / "moved"))
    resumed = PerceptionRun(looks, SPEC, moved, tmp_path / "on", {"data": "y"})
    np.testing.assert_array_equal(weights(begun), weights(resumed))
    PerceptionRun(looks, SPEC, config(16, seed=1), tmp_path / "others", {"data": "x"}).go()
    with pytest.raises(PolicyError, match="another perception weights"):
        PerceptionRun(looks, SPEC, config(64, perception=str(tmp_path / "others")), tmp_path / "on", {"data": "y"})


@pytest.mark.parametrize(
    "changed", [{"net": {}}, {"optimizer": None}, {"averaged": {"module.free.bias": torch.ones(3)}}]
)
def test_damaged_checkpoint_is_refused(changed: dict[str, object], tmp_path: Path, looks: Looks) -> None:
    PerceptionRun(looks, SPEC, config(16), tmp_path, {"data": "x"}).save()
    path = tmp_path / CHECKPOINT_FILE
    write_state(read_state(path) | changed, path)
    with pytest.raises(PolicyError, match=r"checkpoint\.pt is damaged"):
        PerceptionRun(looks, SPEC, config(16), tmp_path, {"data": "x"})


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_device_that_is_not_there_is_refused(tmp_path: Path, looks: Looks) -> None:
    with pytest.raises(PolicyError, match="no CUDA device"):
        PerceptionRun(looks, SPEC, config(16, device="cuda"), tmp_path, {"data": "x"})


@pytest.mark.parametrize(("count", "share"), [(1, 9 / 11), (8, 1 / 2), (10_000, 0.002)])
def test_averages_follow_faster_at_first(count: int, share: float) -> None:
    averages, weights = [torch.zeros(2), torch.ones(1)], [torch.ones(2), torch.full((1,), 3.0)]
    _moving_averages(averages, weights, torch.tensor(count))
    assert averages[0].tolist() == pytest.approx([share, share])
    assert averages[1].tolist() == pytest.approx([1 + 2 * share])
    counters = [torch.tensor(3)]
    _moving_averages(counters, [torch.tensor(7)], torch.tensor(count))
    assert counters[0].item() == 7


def test_loss_that_is_not_finite_ends_training(tmp_path: Path, looks: Looks) -> None:
    run = PerceptionRun(looks, SPEC, config(64), tmp_path, {"data": "x"})
    with torch.no_grad():
        run.net.people.bias.fill_(float("nan"))
    with pytest.raises(PolicyError, match="not finite"):
        run.step()


def test_mirrored_world_is_perceived_mirrored(tmp_path: Path, looks: Looks) -> None:
    """The targets of a mirrored image are those of the mirrored people."""
    run = PerceptionRun(looks, SPEC, config(64), tmp_path, {"data": "x"})
    rows = np.flatnonzero(looks.labels.visible.any(axis=1))[:8]

    class Always:
        def random(self, count: int) -> np.ndarray:
            return np.zeros(count)

        def uniform(self, low: float, high: float, size: tuple[int, ...]) -> np.ndarray:
            return np.zeros(size)

    mirrored, _, (heat, *_) = run._batch(rows, Always())  # type: ignore[arg-type]
    plain_maps, _ = perceive(run.net.eval(), looks, rows, SPEC)
    assert len(plain_maps) == 8
    for k, row in enumerate(rows.tolist()):
        column = int(heat[k].amax(dim=0).argmax())
        bearing = float(looks.labels.people[row, 0, 0])
        assert abs(float(run.grid.bearings_rad[column]) + bearing) < 0.05
        u = 64 + 64 / np.tan(np.radians(50)) * np.tan(bearing)
        assert mirrored[k, 0, 40, int(np.clip(u, 0, 127))] > 0
