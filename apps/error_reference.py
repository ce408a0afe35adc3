"""The page of all error messages, generated from the code that raises them."""

import ast
from collections.abc import Iterator
from html import escape
from pathlib import Path

from readygo.common import errors

_HOLE = "…"
_INTRO = """# Messages

A mistake costs one line and exit code 2. Each says what must hold, what came and what to do; here are all of them, by
kind, so that a line can be searched for. "…" stands for a name, a number or a reason.
"""


def errors_page(root: Path) -> str:
    """The page as Markdown.

    Args:
        root: Folder with the code: `common`, `services`, `apps` below it.
    """
    kinds = {name: kind for name, kind in vars(errors).items() if isinstance(kind, type)}
    found: dict[str, set[str]] = {}
    for path in sorted(path for top in ("common", "services", "runs", "apps") for path in (root / top).rglob("*.py")):
        for name, message in _raised_errors(ast.parse(path.read_text()), set(kinds)):
            found.setdefault(name, set()).add(message)
    parts = [_INTRO]
    for name in sorted(found):
        parts.append(f"## {name}\n\n{(kinds[name].__doc__ or '').splitlines()[0]}\n")
        parts.append("\n".join(f"- {escape(message, quote=False)}" for message in sorted(found[name])) + "\n")
    return "\n".join(parts)


def _raised_errors(tree: ast.AST, kinds: set[str]) -> Iterator[tuple[str, str]]:
    """Name and message of every exception that is raised with a message."""
    for node in ast.walk(tree):
        if not (isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args):
            continue
        kind, message = node.exc.func, _words(node.exc.args[0])
        if isinstance(kind, ast.Name) and kind.id in kinds and message.strip(f"{_HOLE} .:;"):
            yield kind.id, message


def _words(node: ast.expr) -> str:
    """A message with placeholders for its values."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(_words(part) for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _words(node.left) + _words(node.right)
    return _HOLE
