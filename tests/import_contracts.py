"""Contracts of import-linter that see imports by string too: "readygo.a.b:name", import_module("readygo.a")."""

import ast
import importlib.util
import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from grimp import ImportGraph
from importlinter.contracts.forbidden import ForbiddenContract
from importlinter.contracts.independence import IndependenceContract
from importlinter.contracts.layers import LayersContract

_DOTTED = re.compile(r"\w+(?:\.\w+)+(?::\w+)?")


class StringImport(NamedTuple):
    """A module that a string names."""

    imported: str
    line: int
    text: str


def imports_by_string(source: str, modules: Collection[str]) -> Iterator[StringImport]:
    """The modules that a source's strings name, whole: those inside of sentences are none.

    Args:
        source: Python source.
        modules: Names of the modules that there are.
    """
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and _DOTTED.fullmatch(node.value):
            name = node.value.split(":")[0]
            while name and name not in modules:
                name = name.rpartition(".")[0]
            if "." in name:
                yield StringImport(name, node.lineno, repr(node.value))


def computed_imports(source: str) -> Iterator[int]:
    """Lines that import a module whose name is not written there."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            written = len(node.args) == 1 and isinstance(node.args[0], ast.Constant)
            if called in ("import_module", "__import__") and not written:
                yield node.lineno


class _SeesStrings:
    def check(self, graph: ImportGraph, verbose: bool) -> Any:
        modules = {name for name in graph.modules if not graph.is_module_squashed(name)}
        for importer in modules:
            for found in imports_by_string(source_of(importer), modules):
                graph.add_import(
                    importer=importer, imported=found.imported, line_number=found.line, line_contents=found.text
                )
        return super().check(graph, verbose)  # type: ignore[misc]


def source_of(module: str) -> str:
    """The source of a module of ours, which is not imported for it."""
    package, *inner = module.split(".")
    spec = importlib.util.find_spec(package)
    assert spec is not None
    assert spec.origin is not None
    place = Path(spec.origin).parent.joinpath(*inner)
    return (place / "__init__.py" if place.is_dir() else place.with_suffix(".py")).read_text()


class Layers(_SeesStrings, LayersContract):
    """As `layers`, strings included."""


class Forbidden(_SeesStrings, ForbiddenContract):
    """As `forbidden`, strings included."""


class Independence(_SeesStrings, IndependenceContract):
    """As `independence`, strings included."""
