"""The reference that `make docs` writes has no gaps: what it shows of the public names is documented."""

import ast
import enum
import inspect
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import docstring_parser
import pytest

import readygo

ROOT = Path(__file__).resolve().parents[1]
HEAVY = ("torch", "zenoh", "cv2", "numba", "numpy", "mcap", "onnxruntime", "scipy")


def test_import_loads_nothing_heavy() -> None:
    code = f"import sys, readygo; readygo.__version__, dir(readygo); print(sorted({set(HEAVY)} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_errors_and_datasets_do_not_load_kernels() -> None:
    code = "import sys; from readygo import Dataset, ReadygoError; print({'numba', 'cv2', 'torch'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_every_public_name_is_there_and_listed() -> None:
    for name in readygo.__all__:
        assert getattr(readygo, name) is not None
    assert set(readygo.__all__) <= set(dir(readygo))


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'readygo' has no attribute 'Datasett'"):
        _ = readygo.Datasett


def test_type_checkers_see_the_names_that_programs_see() -> None:
    tree = ast.parse(Path(readygo.__file__).read_text())
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module in readygo._NAMES]
    seen = {(node.module, name.name) for node in imports for name in node.names}
    assert seen == {(module, name) for module, names in readygo._NAMES.items() for name in names}


def test_public_names_are_documented_without_gaps() -> None:
    gaps = list(_gaps())
    assert not gaps, "\n".join(gaps)


def _gaps() -> Iterator[str]:
    import pdoc.doc

    for member in pdoc.doc.Module(readygo).members.values():
        if member.name != "__version__":
            yield from _gaps_of(member)


def _gaps_of(member: object) -> Iterator[str]:
    import pdoc.doc

    assert isinstance(member, pdoc.doc.Doc)
    is_constructor = member.name == "__init__"
    if not member.docstring and not is_constructor:
        yield f"{member.qualname} has no docstring"
    if isinstance(member, pdoc.doc.Class):
        for inner in _shown(member):
            yield from _gaps_of(inner)
    elif isinstance(member, pdoc.doc.Function) and not _is_of_dataclass(member):
        text = member.docstring
        if is_constructor:
            text = f"{text}\n\n{inspect.getdoc(getattr(readygo, member.qualname.split('.')[0]))}"
        documented = {entry.arg_name for entry in docstring_parser.parse(text).params}
        for name in inspect.signature(member.obj).parameters:
            if name != "self" and name not in documented:
                yield f"{member.qualname} does not document its argument {name}"


def _shown(cls: object) -> Iterator[object]:
    """The members of a class that its reference shows: public ones and the constructor, not those of builtins."""
    for inner in cls.members.values():
        own = inner.taken_from[0].startswith("readygo")
        if own and (not inner.name.startswith("_") or inner.name == "__init__"):
            yield inner


def _is_of_dataclass(function: object) -> bool:
    """True for a constructor of a dataclass' fields or an enum's values, or that a protocol has not."""
    cls = vars(readygo).get(function.qualname.split(".")[0])
    made = hasattr(cls, "__dataclass_fields__") or (inspect.isclass(cls) and issubclass(cls, enum.Enum))
    made = made or getattr(cls, "_is_protocol", False)
    return function.name == "__init__" and made
