from pathlib import Path

import numpy as np
import pytest

from readygo.common.camera.config import CameraConfig
from readygo.common.errors import PolicyError
from readygo.common.perception import Perception, PerceptionSpec, load_perception
from readygo.common.perception.artifact import save_perception_spec
from readygo.common.perception.grid import SHAPE
from readygo.common.perception.people import CHANNELS
from readygo.common.perception.perception import check_perception_camera
from readygo.common.robot import RobotConfig

SPEC = PerceptionSpec(robot=RobotConfig(camera=CameraConfig(height_px=8, width_px=16)))


class Session:
    """Answers one human, and notes what it was given."""

    def __init__(self) -> None:
        self.fed: list[dict[str, np.ndarray]] = []

    def run(self, outputs: list[str], fed: dict[str, np.ndarray]) -> list[np.ndarray]:
        assert outputs == ["people", "rays"]
        self.fed.append(fed)
        people = np.zeros((CHANNELS, *SHAPE), np.float32)
        people[:, 5, 16] = 0.9, 0.0, 2.0, 0.0, 1.0, 0.1, 0.1, 0.2, 0.2
        return [people, np.full((2, SHAPE[1]), 3.0, np.float32)]


def frame(value: int) -> np.ndarray:
    return np.full((8, 16, 3), value, np.uint8)


def test_newest_images_and_the_motion_between_them_are_given_to_the_graph() -> None:
    session = Session()
    perception = Perception(SPEC, session)
    memory, forward = perception.start(), np.array([1.0, 0.0], np.float32)
    for step in range(13):
        memory.advance(forward)
        if step % 2 == 0:
            memory.see(frame(step))
    perceived = perception.perceive(memory, forward)
    fed = session.fed[0]
    # 0.2 s apart are four steps.
    assert fed["frames"][:, 0, 0, 0].tolist() == [4, 8, 12]
    assert fed["motion"][0] == pytest.approx([-0.4, 0.0, 0.0, -0.2, 0.0, 0.0, 1.0, 0.0], abs=1e-6)
    np.testing.assert_allclose(perceived.people.xy_m, [[2.0, 0.0]], atol=1e-6)
    np.testing.assert_allclose(perceived.people.v_mps, [[0.0, 1.0]], atol=1e-6)
    assert perceived.rays_m.tolist() == [3.0] * SHAPE[1]


def test_motion_ends_at_the_newest_image_if_it_comes_late() -> None:
    session = Session()
    perception = Perception(SPEC, session)
    memory, turning = perception.start(), np.array([0.0, 1.0], np.float32)
    for step in range(15):
        memory.advance(turning)
        # Images come two steps, 0.1 s, after they were taken.
        if step >= 2 and step % 2 == 0:
            memory.see(frame(step), time_ns=(step - 2) * 50_000_000)
    perception.perceive(memory, turning)
    assert session.fed[0]["motion"][0] == pytest.approx([0.0, 0.0, -0.4, 0.0, 0.0, -0.2, 0.0, 1.0], abs=1e-6)


def test_first_image_stands_for_those_before_it() -> None:
    session = Session()
    perception = Perception(SPEC, session)
    memory = perception.start()
    memory.advance(np.zeros(2, np.float32))
    memory.see(frame(7))
    perception.perceive(memory, np.zeros(2, np.float32))
    assert session.fed[0]["frames"][:, 0, 0, 0].tolist() == [7, 7, 7]


def test_another_camera_is_refused_with_what_differs() -> None:
    check_perception_camera(SPEC.robot.camera, SPEC.robot.camera)
    with pytest.raises(PolicyError, match=r"height_px 8 \(the robot's: 144\)"):
        check_perception_camera(SPEC.robot.camera, CameraConfig(width_px=16))


def test_missing_graph_and_missing_folder_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match=r"holds no perception\.toml"):
        load_perception(tmp_path)
    save_perception_spec(SPEC, tmp_path)
    with pytest.raises(PolicyError, match=r"perception\.onnx"):
        load_perception(tmp_path)
    with pytest.raises(PolicyError, match="another camera"):
        load_perception(tmp_path, robot=RobotConfig())
