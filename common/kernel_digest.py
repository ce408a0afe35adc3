"""What the machine code of a kernel depends on, as a hash.

Numba freezes what a function refers to when it compiles it: constants of modules and closures, and functions that it
calls. The hash covers the function's bytecode and flags, the values of all that it refers to, the same of every kernel
that it calls, directly or not, and the versions of the compilers. Where a value is of no known kind, the hash covers
the source of the function's module and of all that it imports of readygo.
"""

import dis
import enum
import functools
import hashlib
import platform
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from llvmlite import ir
from numba.core import config, types
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic

_PACKAGE = Path(__file__).absolute().parents[1]
_COMPILERS = (Path(__file__).absolute(), *(_PACKAGE / "common" / name for name in ("kernels.py", "kernel_cache.py")))
"""How kernels are compiled and kept is no part of a kernel."""
_IMPORT = re.compile(rb"^(?:from|import) readygo\.?([.\w]*)(?: import (\([^)]*\)|.*))?", re.MULTILINE)
_LAZY_IMPORT = re.compile(_IMPORT.pattern.replace(b"^", rb"^[ \t]*", 1), re.MULTILINE)
"""Packages name below `if TYPE_CHECKING` what they load when it is used: every importer may use it."""
_VERSIONED = frozenset([*sys.stdlib_module_names, "numpy", "numba"])
"""Packages whose functions stay the same while the versions do."""
_REFERENCES = frozenset(["LOAD_GLOBAL", "LOAD_NAME"])
_settings: Any = config


def kernel_digest(kernel: Any) -> str:
    """Hash of all that a kernel's machine code depends on besides the types of its arguments.

    Args:
        kernel: A dispatcher of numba.
    """
    order: dict[int, int] = {}
    digest = hashlib.sha256(repr(_compilers()).encode())

    def add(called: Any) -> None:
        # Every kernel once, in the order of the first call: recursive kernels end.
        known = order.get(id(called))
        digest.update(f"kernel {len(order) if known is None else known}\n".encode())
        if known is not None:
            return
        order[id(called)] = len(order)
        own, calls = _own_part(called)
        digest.update(own)
        for inner in calls:
            add(inner)

    add(kernel)
    return digest.hexdigest()[:32]


def type_digest(arguments: Any) -> str:
    """Hash of numba types, and of the classes behind them.

    Args:
        arguments: Numba types of a call.
    """
    return hashlib.sha256(repr([_type_part(argument) for argument in arguments]).encode()).hexdigest()[:32]


@functools.cache
def sources_digest(path: Path) -> str:
    """Hash of a source file and of all files that it imports of readygo, directly or not."""
    digest = hashlib.sha256()
    for source in sorted(_with_imports(path)):
        digest.update(_source(source)[0])
    return digest.hexdigest()[:16]


class _UnknownKindError(Exception):
    """A value whose parts are not known."""


@functools.cache
def _compilers() -> tuple[object, ...]:
    codegen_flags = (_settings.OPT, _settings.BOUNDSCHECK, _settings.LOOP_VECTORIZE, _settings.SLP_VECTORIZE)
    versions = (platform.python_version(), numba.__version__, llvmlite.__version__, np.__version__)
    return ("1", *versions, str(codegen_flags))


@functools.cache
def _own_part(kernel: Any) -> tuple[bytes, tuple[Any, ...]]:
    """A kernel's code, flags and referenced values; the kernels that it calls, in the order of their names."""
    function, calls = kernel.py_func, list[Any]()
    file = Path(function.__code__.co_filename)

    def part(value: Any) -> object:
        if isinstance(value, Dispatcher):
            calls.append(value)
            return "kernel"
        try:
            return _value_part(value)
        except _UnknownKindError:
            return ("source", sources_digest(file))

    closure = [part(cell.cell_contents) for cell in function.__closure__ or ()]
    own = (
        (function.__module__, function.__qualname__, sorted(kernel.targetoptions.items()), str(kernel.locals)),
        _code_part(function.__code__),
        part(function.__defaults__),
        closure,
        [(name, *_global_part(function.__globals__, name, part)) for name in sorted(_global_names(function.__code__))],
    )
    return repr(own).encode(), tuple(calls)


def _global_part(variables: dict[str, Any], name: str, part: Callable[[Any], object]) -> tuple[object, ...]:
    # What is no variable of the module is built in, or defined later: then it is here at the next look.
    return ("global", part(variables[name])) if name in variables else ("builtin",)


def _global_names(code: CodeType) -> set[str]:
    names = {step.argval for step in dis.get_instructions(code) if step.opname in _REFERENCES}
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= _global_names(constant)
    return names


def _code_part(code: CodeType) -> tuple[object, ...]:
    return (
        code.co_code,
        [_code_part(value) if isinstance(value, CodeType) else _value_part(value) for value in code.co_consts],
        (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, code.co_exceptiontable),
        (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags),
    )


def _value_part(value: Any) -> object:
    """A value as nested tuples whose text tells it from every other value.

    Raises:
        _UnknownKindError: If it is of no kind that kernels are known to use.
    """
    kind = type(value)
    if value is None or value is Ellipsis or kind in (bool, int, float, complex, str, bytes):
        return kind.__name__, repr(value)
    if kind is tuple:
        return "tuple", [_value_part(item) for item in value]
    if kind is slice:
        return "slice", [_value_part(item) for item in (value.start, value.stop, value.step)]
    if kind is frozenset:
        return "frozenset", sorted(repr(_value_part(item)) for item in value)
    if isinstance(value, tuple) and hasattr(kind, "_fields"):
        return "named tuple", _class_part(kind), [_value_part(item) for item in value]
    if isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        array = np.asarray(value)
        layout = (kind.__name__, array.dtype.descr, array.shape, array.strides)
        return "array", layout, hashlib.sha256(array.tobytes()).hexdigest()
    if isinstance(value, np.dtype) and not value.hasobject:
        return "dtype", value.descr
    if isinstance(value, enum.Enum):
        return "member", _class_part(kind), value.name
    if isinstance(value, _Intrinsic):
        return _intrinsic_part(value)
    if isinstance(value, types.Type):
        return "type", _type_part(value)
    if isinstance(value, ModuleType):
        if value.__name__.partition(".")[0] in _VERSIONED:
            return "module", value.__name__
    elif isinstance(value, type) and (issubclass(value, enum.Enum) or _is_named_tuple(value)):
        return _class_part(value)
    elif _is_versioned(value):
        return "function", value.__module__, value.__qualname__
    raise _UnknownKindError


def _is_named_tuple(kind: type) -> bool:
    return issubclass(kind, tuple) and hasattr(kind, "_fields")


def _is_versioned(value: Any) -> bool:
    """True for a class or function of Python, numpy or numba."""
    module = getattr(value, "__module__", None)
    named = isinstance(module, str) and isinstance(getattr(value, "__qualname__", None), str)
    return named and callable(value) and str(module).partition(".")[0] in _VERSIONED


def _class_part(kind: type) -> tuple[object, ...]:
    """Fields of a named tuple, or members of an enum."""
    if issubclass(kind, enum.Enum):
        content = [(name, _value_part(member.value)) for name, member in kind.__members__.items()]
        return "enum", kind.__module__, kind.__qualname__, [base.__name__ for base in kind.__mro__], content
    defaults = [(name, _value_part(value)) for name, value in sorted(getattr(kind, "_field_defaults", {}).items())]
    return "fields", kind.__module__, kind.__qualname__, getattr(kind, "_fields", ()), defaults


def _intrinsic_part(intrinsic: Any) -> tuple[object, ...]:
    """Parts of an intrinsic: the sources of the Python code that emits its instructions when a kernel is compiled."""
    made = intrinsic._defn
    closure = [_closure_part(cell.cell_contents) for cell in made.__closure__ or ()]
    return "intrinsic", made.__qualname__, sources_digest(Path(made.__code__.co_filename)), closure


def _closure_part(value: Any) -> object:
    code = getattr(value, "__code__", None)
    if isinstance(value, ir.Type):
        return "llvm type", str(value)
    if code is None:
        return _value_part(value)
    closure = [_closure_part(cell.cell_contents) for cell in value.__closure__ or ()]
    return "function", value.__qualname__, sources_digest(Path(code.co_filename)), closure


def _type_part(kind: Any) -> object:
    """A numba type by its text, and the classes of named tuples, enums and types of readygo behind it."""
    parts: list[object] = [str(kind)]
    if isinstance(kind, types.Dispatcher):
        parts.append(kernel_digest(kind.dispatcher))
    elif type(kind).__module__.partition(".")[0] != "numba":
        parts.append(sources_digest(Path(sys.modules[type(kind).__module__].__file__ or "")))
    if (behind := getattr(kind, "instance_class", None)) is not None:
        parts.append(_class_part(behind))
    if isinstance(kind, types.BaseTuple):
        items: Any = kind
        parts += [_type_part(item) for item in items]
    elif isinstance(inner := getattr(kind, "dtype", None), types.Type) and inner is not kind:
        parts.append(_type_part(inner))
    return parts


def _with_imports(path: Path) -> set[Path]:
    found: set[Path] = set()
    waiting = [path]
    while waiting:
        source = waiting.pop()
        if source not in found:
            found.add(source)
            waiting += _source(source)[1]
    return found


@functools.cache
def _source(path: Path) -> tuple[bytes, tuple[Path, ...]]:
    """Digest of a file as it is when it is first asked for, and the files that it imports itself."""
    text = path.read_bytes()
    imports = _LAZY_IMPORT if path.name == "__init__.py" else _IMPORT
    files = () if path in _COMPILERS else tuple(_imported_files(text, imports))
    return hashlib.sha256(text).digest(), files


def _imported_files(text: bytes, imports: re.Pattern[bytes]) -> Iterator[Path]:
    for module, names in imports.findall(text):
        place = _PACKAGE.joinpath(*module.decode().split(".")) if module else _PACKAGE
        candidates = [place.with_suffix(".py")]
        if (place / "__init__.py").is_file():
            candidates = [place / "__init__.py"]
            candidates += [place / f"{name.decode()}.py" for name in re.findall(rb"\w+", names)]
        yield from (candidate for candidate in candidates if candidate.is_file())
