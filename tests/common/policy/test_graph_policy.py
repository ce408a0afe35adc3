"""A small recurrent graph: it counts its decisions, and drives by what it is given."""

import dataclasses

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec, load_policy, load_spec, save_spec
from readygo.common.policy.artifact import PolicyInputs
from readygo.common.policy.graph import Given, GraphSpec
from readygo.common.robot import RobotRanges
from tests.common.policy.artifacts import ROBOT

NO_COMMAND, AHEAD = np.zeros((1, 2), np.float32), np.array([[3.0, 0.5]], np.float32)
GRAPH = GraphSpec(
    inputs={"pixels": Given.RGB, "near": Given.DEPTH, "where": Given.GOAL},
    state={"count": "count_next"},
    action="command",
)


def write_recurrent(folder, graph=GRAPH, frame_count=2):
    """v is a tenth of the number of decisions so far, w the goal's y and the mean nearness of the newest frame."""
    folder.mkdir(parents=True, exist_ok=True)
    constants = {"one": [[1.0]], "tenth": [[0.1]], "y_axis": [[0.0], [1.0]]}
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
    stored = [numpy_helper.from_array(np.array(value, np.float32), name) for name, value in constants.items()]
    stored += [numpy_helper.from_array(np.array(frame_count - 1, np.int64), "last_index")]
    stored += [numpy_helper.from_array(np.array([1, 1], np.int64), "two")]
    value = helper.make_tensor_value_info
    made = helper.make_graph(
        nodes,
        "recurrent",
        [
            value("pixels", TensorProto.FLOAT, [1, 3 * frame_count, 8, 10]),
            value("near", TensorProto.FLOAT, [1, frame_count, 8, 10]),
            value("where", TensorProto.FLOAT, [1, 2]),
            value("count", TensorProto.FLOAT, ["batch", 1]),
        ],
        [value("command", TensorProto.FLOAT, [1, 2]), value("count_next", TensorProto.FLOAT, ["batch", 1])],
        stored,
    )
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    onnx.checker.check_model(model)
    (folder / "policy.onnx").write_bytes(model.SerializeToString())
    inputs = PolicyInputs(frame_count=frame_count, images=graph.images)
    save_spec(PolicySpec(robot=ROBOT, frame_spacing_s=0.1, inputs=inputs, graph=graph), folder)
    return folder


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
    graph = GraphSpec(inputs=GRAPH.inputs, state=GRAPH.state, action="command", rate_hz=10.0)
    policy = load_policy(write_recurrent(tmp_path, graph))
    for camera_hz in (10, 20, 30):
        memory = policy.start()
        for frame in range(camera_hz):
            time_ns = frame * 10**9 // camera_hz
            memory.move(time_ns, (0.0, 0.0, 0.0))
            policy.see([memory], sight(), [time_ns])
            policy.decide([memory], NO_COMMAND, AHEAD)
        assert memory.kept.state["count"].item() == 10


def test_spec_is_read_as_it_was_written(tmp_path):
    spec = load_spec(write_recurrent(tmp_path))
    assert (spec.graph, spec.inputs.frame_count, spec.inputs.images) == (GRAPH, 2, ("rgb", "depth"))
    assert spec.files == ("policy.onnx", "policy.toml")
    assert not spec.wants_goal_image


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"inputs": {**GRAPH.inputs, "extra": Given.COMMAND}}, r"has the inputs count, near, pixels, where; .*extra"),
        ({"state": {"count": "nothing"}}, "has no output 'nothing'; it has command, count_next"),
        ({"action": "missing"}, "has no output 'missing'"),
    ],
)
def test_graph_that_does_not_fit_its_names_is_refused(tmp_path, change, words):
    fields = {"inputs": GRAPH.inputs, "state": GRAPH.state, "action": "command", **change}
    folder = write_recurrent(tmp_path, GraphSpec(**fields))
    with pytest.raises(PolicyError, match=words):
        load_policy(folder)


def test_graph_of_another_image_size_is_refused(tmp_path):
    folder = write_recurrent(tmp_path)
    (folder / "policy.toml").write_text((folder / "policy.toml").read_text().replace("width_px = 10", "width_px = 12"))
    with pytest.raises(PolicyError, match=r"do not fit its policy\.toml"):
        load_policy(folder)


def test_graph_is_told_which_robot_it_drives_and_held_to_its_limits(tmp_path):
    """It commands twice its robot's limits."""
    value = helper.make_tensor_value_info
    nodes = [
        helper.make_node("Gather", ["robot", "limits"], ["most"], axis=1),
        helper.make_node("Mul", ["most", "two"], ["twice"]),
        helper.make_node("ReduceMean", ["pixels"], ["light"], axes=[1, 2, 3], keepdims=0),
        helper.make_node("Add", ["twice", "light"], ["action"]),
    ]
    stored = [numpy_helper.from_array(np.array([4, 5]), "limits"), numpy_helper.from_array(np.float32([2.0]), "two")]
    inputs = [value("pixels", TensorProto.FLOAT, [1, 3, 8, 10]), value("robot", TensorProto.FLOAT, [1, 6])]
    made = helper.make_graph(nodes, "told", inputs, [value("action", TensorProto.FLOAT, [1, 2])], stored)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    (tmp_path / "policy.onnx").write_bytes(model.SerializeToString())
    graph = GraphSpec(inputs={"pixels": Given.RGB, "robot": Given.ROBOT})
    robot = dataclasses.replace(ROBOT, ranges=RobotRanges(v_max_mps=(0.4, 1.0), w_max_radps=(0.5, 2.0)))
    save_spec(PolicySpec(robot=robot, inputs=PolicyInputs(frame_count=1), graph=graph), tmp_path)
    policy = load_policy(tmp_path)
    memory = policy.start(robot.with_values({"v_max_mps": 0.7, "w_max_radps": 1.5}))
    action = policy.step([memory], np.zeros((1, 8, 10, 3), np.uint8), NO_COMMAND, AHEAD)
    assert action[0].tolist() == pytest.approx([0.7, 1.5])
