"""A browser's handle without a browser: what is added is remembered by name."""

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np


class Node:
    """Anything in a scene or a panel."""

    def __init__(self, scene: "Scene | None", name: str, **values: Any) -> None:
        self._scene, self.name = scene, name
        self.visible = True
        for key, value in values.items():
            setattr(self, key, value)
        self._acts: list[Any] = []

    def remove(self) -> None:
        """Take it and all below it away."""
        assert self._scene is not None
        for name in [name for name in self._scene.nodes if name == self.name or name.startswith(f"{self.name}/")]:
            del self._scene.nodes[name]

    def on_update(self, act: Any) -> None:
        self._acts.append(act)

    on_click = on_update

    def choose(self, value: Any) -> None:
        """What a viewer does."""
        self.value = value
        for act in self._acts:
            act(Node(None, "event", client=True))

    @contextlib.contextmanager
    def add_tab(self, _: str) -> Iterator[None]:
        yield


class Scene:
    """Nodes by name."""

    def __init__(self) -> None:
        self.nodes: dict[str, Node] = {}

    def _add(self, name: str, *arguments: Any, **values: Any) -> Node:
        for argument in arguments:
            if isinstance(argument, np.ndarray) and argument.dtype.kind == "f":
                assert np.isfinite(argument).all(), name
        node = self.nodes[name] = Node(self, name, **values)
        return node

    add_frame = add_mesh_simple = add_camera_frustum = add_gaussian_splats = _add

    def add_label(self, name: str, text: str, **values: Any) -> Node:
        return self._add(name, text=text, **values)

    def add_line_segments(self, name: str, points: Any, colors: Any, **values: Any) -> Node:
        assert points.ndim == 3
        assert len(points)
        assert np.linalg.norm(points[:, 1] - points[:, 0], axis=1).min() > 0, "a viewer cannot draw it"
        return self._add(name, points=points, colors=colors, **values)


class Gui:
    """What can be clicked, by its label; texts by number."""

    def __init__(self) -> None:
        self.inputs: dict[str, Node] = {}
        self.texts: list[Node] = []

    def add_html(self, content: str) -> Node:
        self.texts.append(Node(None, "html", content=content))
        return self.texts[-1]

    def add_tab_group(self) -> Node:
        return Node(None, "tabs")

    def _input(self, label: str, **values: Any) -> Node:
        node = self.inputs[label] = Node(None, label, **values)
        return node

    def add_dropdown(self, label: str, options: list[str], initial_value: str = "") -> Node:
        return self._input(label, options=options, value=initial_value or options[0])

    def add_button_group(self, label: str, options: list[str]) -> Node:
        return self._input(label, options=options, value=options[0])

    def add_slider(self, label: str, low: float, high: float, step: float, value: float, visible: bool) -> Node:
        node = self._input(label, max=high, value=value)
        node.visible = visible
        return node

    def add_checkbox(self, label: str, value: bool, visible: bool = True) -> Node:
        node = self._input(label, value=value)
        node.visible = visible
        return node


class Client:
    """A browser."""

    def __init__(self) -> None:
        self.scene, self.gui = Scene(), Gui()
        self.camera = Node(None, "camera", position=np.zeros(3), look_at=np.zeros(3), fov=1.0, aspect=1.5)
        self.said: list[tuple[str, str]] = []

    @contextlib.contextmanager
    def atomic(self) -> Iterator[None]:
        yield

    def add_notification(self, title: str, body: str, color: str = "") -> None:
        self.said.append((title, body))
