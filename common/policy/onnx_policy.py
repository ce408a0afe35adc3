"""Load a policy's folder and run its graph with onnxruntime: one thread, one episode at a time.

The sums of a batch are grouped differently, and an episode's result would depend on which other episodes run beside it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.arrays import AnyArray, Float32Array, UInt8Array
from readygo.common.errors import PolicyError, ReadygoError, first_line
from readygo.common.extras import install_command
from readygo.common.policy.artifact import SPEC_FILE, PolicySpec, load_spec
from readygo.common.policy.graph import GRAPH_FILE, Given, GraphSpec, Port
from readygo.common.policy.memory import PolicyMemory, SeenFrame
from readygo.common.policy.policy import Policy, check_policy_camera
from readygo.common.policy.sight import channels_by_image, channels_of
from readygo.common.policy.traits import LIMITS_AT
from readygo.common.robot import RobotConfig

_TYPES: Mapping[str, type[np.generic]] = {
    "tensor(uint8)": np.uint8,
    "tensor(float)": np.float32,
    "tensor(double)": np.float64,
    "tensor(int64)": np.int64,
}
_FRAME_JITTER_NS = 5_000_000


def load_policy(folder: str | Path, *, robot: RobotConfig | None = None) -> Policy:
    """Load an exported policy.

    Args:
        folder: The folder that training wrote.
        robot: The robot that it shall drive, one of those that it knows if it knows several; None skips the
            comparison.

    Raises:
        PolicyError: If a file is missing or broken, the format is another version's, the camera differs from
            `robot`'s, or onnxruntime is not installed.
    """
    folder = Path(folder)
    spec = load_spec(folder)
    if robot is not None:
        check_policy_camera(spec, robot)
    policy = OnnxPolicy(spec, open_session(folder / GRAPH_FILE))
    _check_graph(policy, folder)
    return policy.for_robot(robot) if robot is not None and spec.robot.ranges.varies else policy


class OnnxPolicy(Policy):
    """A policy of one ONNX graph that `policy.toml` describes, see `readygo.common.policy.graph`."""

    def __init__(self, spec: PolicySpec, session: Any) -> None:
        """Check that the graph fits its spec; `load_policy` makes one from files.

        Args:
            spec: What it was trained for.
            session: onnxruntime's session of the graph.

        Raises:
            PolicyError: If the graph has other inputs or outputs than `policy.toml` says.
        """
        super().__init__(spec)
        self._graph, self._session = spec.graph, session
        self._ports = _ports(self._graph, session)
        self._channels = {name: slice(of[0], of[-1] + 1) for name, of in channels_by_image(spec.images).items()}

    def decide(
        self,
        memories: Sequence[PolicyMemory],
        commands: Float32Array,
        goals_xy_m: Float32Array,
    ) -> Float32Array:
        """Commands v [m/s], w [rad/s], shape (B, 2); a graph with a rate holds its last one in between.

        Raises:
            PolicyError: If it wants an image of the goal, and there is none.
        """
        rows = [
            self._decide(memory, command, goal)
            for memory, command, goal in zip(memories, commands, goals_xy_m, strict=True)
        ]
        return np.stack(rows) if rows else np.empty((0, 2), np.float32)

    def _decide(self, memory: PolicyMemory, command: Float32Array, goal_xy_m: Float32Array) -> Float32Array:
        if self._graph.rate_hz is None:
            return self._run(memory, command, goal_xy_m)
        kept, now_ns = memory.kept, memory.seen_ns
        if kept.decision is not None and now_ns < kept.due_ns - _FRAME_JITTER_NS:
            return kept.decision
        period_ns = round(1e9 / self._graph.rate_hz)
        # Its rhythm is kept where images come nearly in time, and starts again after a pause.
        late = kept.decision is None or now_ns - kept.due_ns >= period_ns
        kept.decision = self._run(memory, command, goal_xy_m)
        kept.due_ns = (now_ns if late else kept.due_ns) + period_ns
        return kept.decision

    def _run(self, memory: PolicyMemory, command: Float32Array, goal_xy_m: Float32Array) -> Float32Array:
        """Run the graph once; state and cache are brought up to date."""
        graph, kept, frames = self._graph, memory.kept, memory.window()
        goal = [self._goal_frame(memory)] if self.spec.wants_goal_image else []
        # A frame stands in the window more than once where there were fewer before it.
        distinct = dict.fromkeys([*frames, *goal])
        known, new = [f for f in distinct if f.cached], [f for f in distinct if not f.cached]
        rows = {frame: row for row, frame in enumerate([*known, *new])}
        fed = {name: kept.state.get(name, self._ports[name].zeros()) for name in graph.state}
        fed |= {name: self._ports[name].rows([frame.cached[name] for frame in known]) for name in graph.cache}
        seen = self._stack_frames(new if graph.cache else frames)
        numbers = {Given.GOAL: goal_xy_m, Given.COMMAND: command, Given.ROBOT: memory.traits}
        for name, given in graph.inputs.items():
            port = self._ports[name]
            if given in self._channels:
                fed[name] = port.images(seen[..., self._channels[given]], together=not graph.cache)
            elif given == Given.GOAL_IMAGE:
                fed[name] = port.images(self._stack_frames(goal))
            elif given == Given.WINDOW:
                fed[name] = np.array([rows[frame] for frame in frames], port.dtype)
            elif given == Given.GOAL_FRAME:
                fed[name] = np.array([rows[frame] for frame in goal], port.dtype)
            elif given in (Given.MOTION, Given.IMAGE_MOTION):
                present_ns = memory.seen_ns if given == Given.IMAGE_MOTION else None
                fed[name] = np.asarray(memory.own_motion(command, present_ns), port.dtype)[None]
            else:
                fed[name] = np.asarray(numbers[Given(given)], port.dtype)[None]
        action, *after = self._session.run(graph.outputs, fed)
        if graph.moving:
            moving, *after = after
            action = moving if memory.must_move() else action
        kept.state = dict(zip(graph.state, after, strict=False))
        for name, cached in zip(graph.cache, after[len(graph.state) :], strict=True):
            for frame, row in zip(new, cached, strict=True):
                frame.cached[name], frame.image = row, None
        return self._clip_to_limits(action, memory.traits[LIMITS_AT:])

    def _stack_frames(self, frames: Sequence[SeenFrame]) -> UInt8Array:
        """Images of frames that are not encoded yet, shape (N, H, W, C)."""
        images, camera = [frame.image for frame in frames if frame.image is not None], self.spec.robot.camera
        shape = (0, camera.height_px, camera.width_px, channels_of(self.spec.images))
        return np.stack(images) if images else np.empty(shape, np.uint8)

    def _goal_frame(self, memory: PolicyMemory) -> SeenFrame:
        if memory.kept.goal is None:
            raise PolicyError(
                "The policy wants an image of the goal: `readygo evaluate` draws it, `readygo drive` takes "
                "--goal-image FILE."
            )
        return memory.kept.goal

    def _clip_to_limits(self, action: AnyArray, limits: Float32Array) -> Float32Array:
        if action.size != 2:
            raise PolicyError(f"The policy's {self._graph.action} must be v and w, got {action.size} numbers.")
        (v, w), (v_max, w_max) = action.reshape(2).tolist(), limits.tolist()
        slowest = self.spec.robot.v_min_mps / self.spec.robot.v_max_mps
        return np.array([min(max(v, slowest * v_max), v_max), min(max(w, -w_max), w_max)], np.float32)


def open_session(
    path: Path,
    *,
    what: str = "Policy file",
    remedy: str = "export the policy again",
    raises: type[ReadygoError] = PolicyError,
) -> Any:
    """An onnxruntime session of one thread.

    Args:
        path: The graph.
        what: What messages call the file.
        remedy: What they advise.
        raises: Error to raise.

    Raises:
        ReadygoError: If the file is missing or broken, or onnxruntime is not installed.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise raises(f"onnxruntime is not installed; run: {install_command('policy')}") from error
    if not path.is_file():
        raise raises(f"{what} {path} is missing; {remedy}.")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises a dozen unrelated types for a broken file
        raise raises(f"{what} {path} cannot be loaded: {first_line(error)}; {remedy}.") from error


def _check_graph(policy: Policy, folder: Path) -> None:
    camera, zeros = policy.spec.robot.camera, np.zeros((1, 2), np.float32)
    shape = (1, camera.height_px, camera.width_px, channels_of(policy.spec.images))
    memory = policy.start()
    memory.show_goal(np.zeros((*shape[1:3], 3), np.uint8))
    images = np.zeros(shape, np.uint8)
    try:
        # An episode's first image, no new image, and one more: with a cache the graph is given other numbers of frames.
        policy.step([memory], images, zeros, zeros)
        memory.kept.decision = None
        policy.decide([memory], zeros, zeros)
        memory.kept.decision = None
        policy.step([memory], images, zeros, zeros)
    except PolicyError:
        raise
    except Exception as error:  # as above: a graph of other inputs or shapes
        raise PolicyError(f"The graph of {folder} does not fit its {SPEC_FILE}: {first_line(error)}.") from error


def _ports(graph: GraphSpec, session: Any) -> dict[str, Port]:
    """The graph's inputs by name.

    Raises:
        PolicyError: If it has others than it is given, lacks an output, or one is of a type that no input provides.
    """
    inputs, outputs = {item.name: item for item in session.get_inputs()}, {item.name for item in session.get_outputs()}
    named = {*graph.inputs, *graph.state, *graph.cache}
    if set(inputs) != named:
        found, wanted = ", ".join(sorted(inputs)), ", ".join(sorted(named))
        raise PolicyError(f"The policy's graph has the inputs {found}; its policy.toml names {wanted}.")
    if missing := [name for name in graph.outputs if name not in outputs]:
        raise PolicyError(f"The policy's graph has no output {missing[0]!r}; it has {', '.join(sorted(outputs))}.")
    unknown = [item for item in inputs.values() if item.type not in _TYPES]
    if unknown:
        raise PolicyError(f"The policy's input {unknown[0].name} is {unknown[0].type}; make it float or uint8.")
    return {name: Port(_TYPES[item.type], tuple(item.shape)) for name, item in inputs.items()}
