"""Small graphs: a recurrent one that counts its decisions, and one that keeps the latents of its frames."""

import dataclasses

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from readygo.common.errors import PolicyError
from readygo.common.images.names import RGB
from readygo.common.policy import PolicySpec, load_policy, load_spec, save_spec
from readygo.common.policy.graph import GRAPH_FILE, Given, GraphSpec
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.common.robot.ranges import RobotRanges
from readygo.common.robot.standing import WAIT_S
from tests.common.policy.artifacts import ROBOT, write_goal_policy, write_graph, write_policy

NO_COMMAND, AHEAD = np.zeros((1, 2), np.float32), np.array([[3.0, 0.5]], np.float32)
GRAPH = GraphSpec(
    frame_count=2,
    inputs={"pixels": "rgb", "near": "depth", "where": Given.GOAL},
    state={"count": "count_next"},
    cache={},
    action="command",
    rate_hz=20.0,
)


def write_recurrent(folder, graph=GRAPH):
    """v is a tenth of the number of decisions so far, w the goal's y and the mean nearness of the newest frame."""
    constants = {"one": np.float32([[1.0]]), "tenth": np.float32([[0.1]]), "y_axis": np.float32([[0.0], [1.0]])}
    constants |= {"last_index": np.array(1), "two": np.array([1, 1])}
    nodes = [
        helper.make_node("Add", ["count", "one"], ["count_next"]),
        helper.make_node("Mul", ["count_next", "tenth"], ["v"]),
        helper.make_node("MatMul", ["where", "y_axis"], ["side"]),
        helper.make_node("Gather", ["near", "last_index"], ["newest"], axis=1),
        helper.make_node("ReduceMean", ["newest"], ["nearness"], axes=[1, 2], keepdims=0),
        helper.make_node("Reshape", ["nearness", "two"], ["nearness_2d"]),
        helper.make_node("ReduceMean", ["pixels"], ["light"], axes=[1, 2, 3], keepdims=0),
        helper.make_node("Reshape", ["light", "two"], ["light_2d"]),
        helper.make_node("Sum", ["side", "nearness_2d", "light_2d"], ["w"]),
        helper.make_node("Concat", ["v", "w"], ["command"], axis=1),
    ]
    inputs = {"pixels": (1, 6, 8, 10), "near": (1, 2, 8, 10), "where": (1, 2), "count": ("batch", 1)}
    outputs = {"command": (1, 2), "count_next": ("batch", 1)}
    taken = {name: (TensorProto.FLOAT, shape) for name, shape in inputs.items()}
    return write_graph(
        folder, PolicySpec(robot=ROBOT, frame_spacing_s=0.1, graph=graph), nodes, taken, outputs, constants
    )


def sight(nearness=0):
    image = np.zeros((1, 8, 10, 4), np.uint8)
    image[..., 3] = nearness
    return image


def test_state_goes_from_decision_to_decision_and_is_zero_at_the_start(tmp_path):
    policy = load_policy(write_recurrent(tmp_path))
    one, other = policy.start(), policy.start()
    for count in range(1, 5):
        assert policy.step([one], sight(), NO_COMMAND, AHEAD)[0] == pytest.approx([0.1 * count, 0.5])
    both = policy.step(
        [one, other], np.concatenate([sight(), sight()]), np.tile(NO_COMMAND, (2, 1)), np.tile(AHEAD, (2, 1))
    )
    assert both[:, 0] == pytest.approx([0.5, 0.1])


def test_images_goal_and_depths_come_under_the_graphs_own_names_and_the_limits_hold(tmp_path):
    policy = load_policy(write_recurrent(tmp_path))
    memory = policy.start()
    assert policy.step([memory], sight(51), NO_COMMAND, 0 * AHEAD)[0, 1] == pytest.approx(0.2)
    bright = sight()
    bright[..., :3] = 255
    # Half of what it sees is the frame before.
    bright_w = policy.step([memory], bright, NO_COMMAND, 0 * AHEAD)[0, 1]
    assert bright_w == pytest.approx(0.5)
    for _ in range(20):
        v, w = policy.step([memory], sight(), NO_COMMAND, 9 * AHEAD)[0]
    assert (v, w) == pytest.approx((ROBOT.v_max_mps, ROBOT.w_max_radps))


def test_policy_decides_at_its_own_rate_whatever_the_cameras_is(tmp_path):
    graph = dataclasses.replace(GRAPH, rate_hz=10.0)
    policy = load_policy(write_recurrent(tmp_path, graph))
    for camera_hz in (10, 20, 30):
        memory = policy.start()
        for frame in range(camera_hz):
            time_ns = frame * 10**9 // camera_hz
            memory.move(time_ns, (0.0, 0.0, 0.0))
            policy.see([memory], sight(), [time_ns])
            policy.decide([memory], NO_COMMAND, AHEAD)
        assert memory.kept.state["count"].item() == 10


def test_robot_that_stood_too_long_follows_the_command_that_moves(tmp_path):
    """The command that moves is here the state, (0.1, 0.1) times the number of decisions so far."""
    nodes = [
        helper.make_node("Sum", ["count", "one"], ["count_next"]),
        helper.make_node("Mul", ["count_next", "tenth"], ["go"]),
        helper.make_node("ReduceMean", ["pixels"], ["light"], axes=[1, 2, 3], keepdims=0),
        helper.make_node("Mul", ["light", "none"], ["command"]),
    ]
    graph = GraphSpec(
        inputs={"pixels": "rgb"}, state={"count": "count_next"}, cache={}, frame_count=1, rate_hz=10.0,
        action="command", moving="go",
    )  # fmt: skip
    write_graph(
        tmp_path,
        PolicySpec(robot=ROBOT, graph=graph),
        nodes,
        {"pixels": (TensorProto.FLOAT, (1, 3, 8, 10)), "count": (TensorProto.FLOAT, (1, 2))},
        {"command": (1, 2), "count_next": (1, 2), "go": (1, 2)},
        {"one": np.float32([[1.0, 1.0]]), "tenth": np.float32([[0.001, 0.001]]), "none": np.float32([[0.0, 0.0]])},
    )
    policy = load_policy(tmp_path)
    assert policy.spec.graph == graph

    def drive(speed_mps: float) -> list[list[float]]:
        memory, commands = policy.start(), []
        for step in range(round(10 * WAIT_S) + 2):
            memory.move(step * 10**8, (0.1 * speed_mps * step, 0.0, 0.0))
            policy.see([memory], sight()[..., :3], [step * 10**8])
            commands += policy.decide([memory], NO_COMMAND, AHEAD).tolist()
        return commands

    stood = drive(0.0)
    assert stood[:-2] == [[0.0, 0.0]] * round(10 * WAIT_S)
    assert stood[-2:] == [pytest.approx([0.001 * count] * 2) for count in (101, 102)]
    assert drive(0.1) == [[0.0, 0.0]] * len(stood)


def test_spec_is_read_as_it_was_written(tmp_path):
    spec = load_spec(write_recurrent(tmp_path))
    assert (spec.graph, spec.images) == (GRAPH, ("rgb", "depth"))
    assert not spec.wants_goal_image


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"inputs": {**GRAPH.inputs, "extra": Given.COMMAND}}, r"has the inputs count, near, pixels, where; .*extra"),
        ({"state": {"count": "nothing"}}, "has no output 'nothing'; it has command, count_next"),
        ({"action": "missing"}, "has no output 'missing'"),
        ({"moving": "missing"}, "has no output 'missing'"),
    ],
)
def test_graph_that_does_not_fit_its_names_is_refused(tmp_path, change, words):
    folder = write_recurrent(tmp_path, dataclasses.replace(GRAPH, **change))
    with pytest.raises(PolicyError, match=words):
        load_policy(folder)


def test_graph_of_another_image_size_is_refused(tmp_path):
    folder = write_recurrent(tmp_path)
    (folder / "policy.toml").write_text((folder / "policy.toml").read_text().replace("width_px = 10", "width_px = 12"))
    with pytest.raises(PolicyError, match=r"does not fit its policy\.toml"):
        load_policy(folder)


def test_graph_is_told_which_robot_it_drives_and_held_to_its_limits(tmp_path):
    """It commands twice its robot's limits."""
    nodes = [
        helper.make_node("Gather", ["robot", "limits"], ["most"], axis=1),
        helper.make_node("Mul", ["most", "two"], ["twice"]),
        helper.make_node("ReduceMean", ["pixels"], ["light"], axes=[1, 2, 3], keepdims=0),
        helper.make_node("Add", ["twice", "light"], ["action"]),
    ]
    graph = GraphSpec(inputs={"pixels": "rgb", "robot": Given.ROBOT}, cache={}, frame_count=1)
    robot = dataclasses.replace(ROBOT, ranges=RobotRanges(v_max_mps=(0.4, 1.0), w_max_radps=(0.5, 2.0)))
    write_graph(
        tmp_path,
        PolicySpec(robot=robot, graph=graph),
        nodes,
        {"pixels": (TensorProto.FLOAT, (1, 3, 8, 10)), "robot": (TensorProto.FLOAT, (1, 6))},
        {"action": (1, 2)},
        {"limits": np.array([4, 5]), "two": np.float32([2.0])},
    )
    policy = load_policy(tmp_path)
    memory = policy.start(robot.with_values({"v_max_mps": 0.7, "w_max_radps": 1.5}))
    action = policy.step([memory], np.zeros((1, 8, 10, 3), np.uint8), NO_COMMAND, AHEAD)
    assert action[0].tolist() == pytest.approx([0.7, 1.5])


class CountingSession:
    """Counts the frames that a graph encodes."""

    def __init__(self, session):
        self._session, self.encoded = session, []
        self.get_inputs, self.get_outputs = session.get_inputs, session.get_outputs

    def run(self, outputs, fed):
        self.encoded.append(len(fed["rgb"]))
        return self._session.run(outputs, fed)


def counting_policy(folder):
    policy = load_policy(write_policy(folder))
    policy._session = CountingSession(policy._session)
    return policy


def images(count, seed=1):
    return np.random.default_rng(seed).integers(0, 256, (count, 8, 10, 3), dtype=np.uint8)


def test_result_does_not_depend_on_who_drives_beside(tmp_path):
    policy, goals = load_policy(write_policy(tmp_path)), np.array([[3, 1], [2, -1]], np.float32)
    together, alone = [policy.start() for _ in range(2)], [policy.start() for _ in range(2)]
    for seed in range(12):
        seen, previous = images(2, seed) // 64, np.float32([[0.2, 0.1], [0.5, -0.3]])
        both = policy.step(together, seen, previous, goals)
        for row in range(2):
            own = slice(row, row + 1)
            assert np.array_equal(both[own], policy.step(alone[own], seen[own], previous[own], goals[own]))
        assert not np.array_equal(both[0], both[1])


def test_decisions_are_those_of_the_same_maps_as_encoder_and_head(tmp_path):
    """The numbers are those of the two graphs that a policy was before it was one."""
    policy, rng, decided = load_policy(write_policy(tmp_path)), np.random.default_rng(1), []
    memory = policy.start()
    for step in range(24):
        image, command = rng.integers(0, 4, (1, 8, 10, 3), dtype=np.uint8), np.float32([[0.04 * step, 0.3]])
        decided.append(policy.step([memory], image, command, np.float32([[3, 1]]))[0])
    expected = [[0.592663, -0.079829], [0.729283, -0.127948], [0.414714, -0.309881]]
    assert np.array(decided[7::8]) == pytest.approx(np.array(expected), abs=2e-6)


def test_each_frame_is_encoded_once_and_decisions_between_two_images_encode_none(tmp_path):
    policy = counting_policy(tmp_path)
    memory, first = policy.start(), images(30)
    for step, image in enumerate(first):
        memory.advance(NO_COMMAND[0])
        if step % 3 == 0:
            policy.see([memory], image[None])
        policy.decide([memory], NO_COMMAND, AHEAD)
    assert policy._session.encoded == [int(step % 3 == 0) for step in range(30)]
    assert all(frame.image is None for frame in memory.window())


def test_frames_that_no_decision_sees_are_not_encoded(tmp_path):
    policy = counting_policy(tmp_path)
    memory, every = policy.start(), policy.start()
    for step, image in enumerate(images(41)):
        for one in (memory, every):
            one.advance(NO_COMMAND[0])
            policy.see([one], image[None])
        expected = policy.decide([every], NO_COMMAND, AHEAD)
        if step % 8 == 0:
            assert policy.decide([memory], NO_COMMAND, AHEAD) == pytest.approx(expected, abs=1e-5)
    encoded = [count for count in policy._session.encoded if count != 1]
    assert max(encoded) <= 3
    assert sum(policy._session.encoded) < 41 + 20


def test_image_of_the_goal_is_missed_with_the_options_that_give_it(tmp_path):
    policy = load_policy(write_goal_policy(tmp_path))
    with pytest.raises(PolicyError, match="--goal-image FILE"):
        policy.step([policy.start()], images(1), NO_COMMAND, AHEAD)


@pytest.mark.parametrize("name", ["policy.onnx", "policy.toml"])
def test_missing_file_is_named(tmp_path, name):
    (write_policy(tmp_path) / name).unlink()
    with pytest.raises(PolicyError, match=name):
        load_policy(tmp_path)


def test_broken_graph_is_named_in_one_line(tmp_path):
    (write_policy(tmp_path) / "policy.onnx").write_bytes(b"not a graph")
    with pytest.raises(PolicyError, match=r"policy\.onnx") as caught:
        load_policy(tmp_path)
    assert "\n" not in str(caught.value)


def test_graph_that_does_not_fit_the_robots_images_is_refused(tmp_path):
    spec = load_spec(write_policy(tmp_path))
    save_spec(dataclasses.replace(spec, robot=RobotConfig()), tmp_path)
    with pytest.raises(PolicyError, match="does not fit"):
        load_policy(tmp_path)


def test_graph_that_takes_no_decision_between_two_images_is_refused(tmp_path):
    path = write_policy(tmp_path) / GRAPH_FILE
    model = onnx.load(path)
    (image,) = [value for value in model.graph.input if value.name == RGB]
    image.type.tensor_type.shape.dim[0].dim_value = 1
    onnx.save(model, path)
    with pytest.raises(PolicyError, match="does not fit"):
        load_policy(tmp_path)


def test_images_of_another_size_are_refused(tmp_path):
    policy = load_policy(write_policy(tmp_path))
    with pytest.raises(PolicyError, match=r"8x10 px, got 8x12"):
        policy.see([policy.start()], np.zeros((1, 8, 12, 3), np.uint8))


def test_robot_with_another_image_size_is_refused(tmp_path):
    with pytest.raises(PolicyError, match=r"height_px 8 \(the robot's: 144\), width_px 10 \(the robot's: 256\)"):
        load_policy(write_policy(tmp_path), robot=RobotConfig())


def test_robot_with_another_mount_is_refused(tmp_path):
    robot = RobotConfig(camera=CameraConfig(height_px=8, width_px=10, mount_height_m=0.9))
    with pytest.raises(PolicyError, match=r"another camera: mount_height_m 0\.5 \(the robot's: 0\.9\); ") as caught:
        load_policy(write_policy(tmp_path), robot=robot)
    assert "\n" not in str(caught.value)
