"""Run a policy of one graph, see `readygo.common.policy.graph`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.errors import PolicyError
from readygo.common.policy.artifact import PolicySpec
from readygo.common.policy.graph import Given, GraphSpec, Port
from readygo.common.policy.memory import PolicyMemory
from readygo.common.policy.policy import Policy
from readygo.common.policy.sight import channels_by_image
from readygo.common.policy.traits import LIMITS_AT

_TYPES: Mapping[str, type[np.generic]] = {
    "tensor(uint8)": np.uint8,
    "tensor(float)": np.float32,
    "tensor(double)": np.float64,
    "tensor(int64)": np.int64,
}
_FRAME_JITTER_NS = 5_000_000


class GraphPolicy(Policy):
    """A policy of one ONNX graph that `policy.toml` describes."""

    def __init__(self, spec: PolicySpec, session: Any) -> None:
        """Check that the graph fits its spec; `load_policy` makes one from files.

        Args:
            spec: What it was trained for, with a graph.
            session: onnxruntime's session of it.

        Raises:
            PolicyError: If the graph has other inputs or outputs than `policy.toml` says.
        """
        super().__init__(spec)
        assert spec.graph is not None
        self._graph: GraphSpec = spec.graph
        self._session = session
        self._ports = _ports(self._graph, session)
        self._frame_channels = channels_by_image(spec.inputs.images)

    def remembered_image(self, images: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        """The images themselves, unchanged: the graph takes images, not latents."""
        self.check_images(images)
        return images

    def decide(
        self,
        memories: Sequence[PolicyMemory],
        commands: npt.NDArray[np.float32],
        goals_xy_m: npt.NDArray[np.float32],
    ) -> npt.NDArray[np.float32]:
        """Commands v [m/s], w [rad/s], shape (B, 2); between two decisions of the graph the last one holds.

        Raises:
            PolicyError: If it wants an image of the goal, and there is none.
        """
        rows = [
            self._decide(memory, command, goal)
            for memory, command, goal in zip(memories, commands, goals_xy_m, strict=True)
        ]
        return np.stack(rows) if rows else np.empty((0, 2), np.float32)

    def _decide(
        self, memory: PolicyMemory, command: npt.NDArray[np.float32], goal_xy_m: npt.NDArray[np.float32]
    ) -> npt.NDArray[np.float32]:
        kept, now_ns = memory.kept, memory.seen_ns
        if kept.decision is not None and now_ns < kept.due_ns - _FRAME_JITTER_NS:
            return kept.decision
        fed = {name: self._given(name, given, memory, command, goal_xy_m) for name, given in self._graph.inputs.items()}
        fed |= {name: kept.state.get(name, self._ports[name].zeros()) for name in self._graph.state}
        action, *after = self._session.run([self._graph.action, *self._graph.state.values()], fed)
        kept.state = dict(zip(self._graph.state, after, strict=True))
        period_ns = round(1e9 / self._graph.rate_hz)
        # Its rhythm is kept where images come nearly in time, and starts again after a pause.
        late = kept.decision is None or now_ns - kept.due_ns >= period_ns
        kept.decision = self._limited(action, memory.traits[LIMITS_AT:])
        kept.due_ns = (now_ns if late else kept.due_ns) + period_ns
        return kept.decision

    def _given(
        self,
        name: str,
        given: Given,
        memory: PolicyMemory,
        command: npt.NDArray[np.float32],
        goal_xy_m: npt.NDArray[np.float32],
    ) -> npt.NDArray[Any]:
        port = self._ports[name]
        if given in (Given.RGB, Given.DEPTH):
            return port.images(np.stack(memory.window())[..., self._frame_channels[given.value]])
        if given is Given.GOAL_IMAGE:
            if memory.kept.goal_image is None:
                raise PolicyError(
                    "The policy wants an image of the goal: `readygo evaluate` draws it, `readygo drive` takes "
                    "--goal-image FILE."
                )
            return port.images(memory.kept.goal_image[None])
        numbers = {Given.GOAL: goal_xy_m, Given.COMMAND: command, Given.ROBOT: memory.traits}.get(given)
        return np.asarray(memory.own_motion(command) if numbers is None else numbers, port.dtype)[None]

    def _limited(self, action: npt.NDArray[Any], limits: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        if action.size != 2:
            raise PolicyError(f"The policy's {self._graph.action} must be v and w, got {action.size} numbers.")
        (v, w), (v_max, w_max) = action.reshape(2).tolist(), limits.tolist()
        slowest = self.spec.robot.v_min_mps / self.spec.robot.v_max_mps
        return np.array([np.clip(v, slowest * v_max, v_max), np.clip(w, -w_max, w_max)], np.float32)


def _ports(graph: GraphSpec, session: Any) -> dict[str, Port]:
    """The graph's inputs by name.

    Raises:
        PolicyError: If it has others than it is given, lacks an output, or one is of a type that no input provides.
    """
    inputs, outputs = {item.name: item for item in session.get_inputs()}, {item.name for item in session.get_outputs()}
    named = {*graph.inputs, *graph.state}
    if set(inputs) != named:
        found, wanted = ", ".join(sorted(inputs)), ", ".join(sorted(named))
        raise PolicyError(f"The policy's graph has the inputs {found}; its policy.toml names {wanted}.")
    if missing := [name for name in (graph.action, *graph.state.values()) if name not in outputs]:
        raise PolicyError(f"The policy's graph has no output {missing[0]!r}; it has {', '.join(sorted(outputs))}.")
    unknown = [item for item in inputs.values() if item.type not in _TYPES]
    if unknown:
        raise PolicyError(f"The policy's input {unknown[0].name} is {unknown[0].type}; make it float or uint8.")
    return {name: Port(_TYPES[item.type], tuple(item.shape)) for name, item in inputs.items()}
