"""Small changes of a source file that a good test notices.

A change replaces the text of one node of the syntax tree and leaves all other bytes as they are. Texts, docstrings,
annotations, decorators, assertions, raised errors, log lines and declarations (fields of classes, literals at the top
of a module) stay.
"""

import ast
import re
from dataclasses import dataclass

SWAPPED_SYMBOLS = {
    ast.Lt: ("boundary", "<", "<="),
    ast.LtE: ("boundary", "<=", "<"),
    ast.Gt: ("boundary", ">", ">="),
    ast.GtE: ("boundary", ">=", ">"),
    ast.Eq: ("equality", "==", "!="),
    ast.NotEq: ("equality", "!=", "=="),
    ast.Add: ("arithmetic", "+", "-"),
    ast.Sub: ("arithmetic", "-", "+"),
    ast.Mult: ("arithmetic", "*", "/"),
    ast.Div: ("arithmetic", "/", "*"),
    ast.BitAnd: ("bits", "&", "|"),
    ast.BitOr: ("bits", "|", "&"),
    ast.And: ("and/or", "and", "or"),
    ast.Or: ("and/or", "or", "and"),
}
"""Operator of the tree: kind of the change, its symbol, and the one that replaces it."""
SWAPPED_NAMES = {
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any",
    "argmin": "argmax", "argmax": "argmin", "floor": "ceil", "ceil": "floor", "sin": "cos", "cos": "sin",
    "amin": "amax", "amax": "amin", "nanmin": "nanmax", "nanmax": "nanmin",
}  # fmt: skip
"""Functions and methods that others replace."""
REMOVED_CALLS = ("abs", "fabs", "reversed", "round")
LOGGERS = re.compile(r"^_?(log|logger|logging|warnings|console|print|LOG|stdout|stderr)$")
INDEX_NAMES = re.compile(r"^(i|j|k|n|t|.*(index|row|column|col|step|seq|number|place|frame|rank|level))$")
PATH_NAMES = re.compile(r"(path|folder|root|dir|file|home|out|data|tmp|here|place)\w*$", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class Mutation:
    """One change of one file."""

    file: str
    """Path from the root of the tree."""
    line: int
    """First changed line, from 1."""
    function: str
    """Qualified name of the function around it; empty at the top of a module."""
    operator: str
    """Kind of the change."""
    before: str
    """The whole lines before, stripped."""
    after: str
    """The whole lines after, stripped."""
    begin: int
    """First changed byte of the file."""
    end: int
    """End of the changed bytes."""
    text: str
    """What they become."""

    @property
    def key(self) -> tuple[str, str, str, str, str]:
        """Tells the change from others, also after lines above it have moved."""
        return self.file, self.function, self.operator, self.before, self.after

    def apply(self, source: bytes) -> bytes:
        """The changed file."""
        return source[: self.begin] + self.text.encode() + source[self.end :]

    def compiles(self, source: bytes) -> bool:
        """True if the changed file is Python, and other Python than before."""
        try:
            return ast.dump(ast.parse(self.apply(source))) != ast.dump(ast.parse(source))
        except SyntaxError:
            return False


def find_mutations(file: str, source: bytes) -> list[Mutation]:
    """All changes of a file, in the order of its lines; see `Mutation.compiles`.

    Args:
        file: Path from the root of the tree.
        source: Its bytes, UTF-8.
    """
    finder = _Finder(source)
    finder.visit(ast.parse(source))
    found = []
    for function, operator, begin, end, text in sorted(finder.found, key=lambda one: one[2]):
        first, last = source.rfind(b"\n", 0, begin) + 1, _end_of_line(source, end)
        found.append(
            Mutation(
                file=file,
                line=source.count(b"\n", 0, begin) + 1,
                function=function,
                operator=operator,
                before=source[first:last].decode().strip(),
                after=(source[first:begin] + text.encode() + source[end:last]).decode().strip(),
                begin=begin,
                end=end,
                text=text,
            )
        )
    return found


def _end_of_line(source: bytes, place: int) -> int:
    end = source.find(b"\n", place)
    return len(source) if end < 0 else end


class _Finder(ast.NodeVisitor):
    """Collects (function, operator, begin, end, text)."""

    def __init__(self, source: bytes) -> None:
        self.found: list[tuple[str, str, int, int, str]] = []
        self._source = source
        self._lines = [0, *(match.end() for match in re.finditer(b"\n", source))]
        self._names: list[str] = []
        self._in_function = 0
        self._may_be_none = False

    def _begin(self, node: ast.AST) -> int:
        return self._lines[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]

    def _end(self, node: ast.AST) -> int:
        return self._lines[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]

    def _text(self, node: ast.AST) -> str:
        return self._source[self._begin(node) : self._end(node)].decode()

    def _add(self, operator: str, node: ast.AST, text: str) -> None:
        self._add_at(operator, self._begin(node), self._end(node), text)

    def _add_at(self, operator: str, begin: int, end: int, text: str) -> None:
        self.found.append((".".join(self._names), operator, begin, end, text))

    def _swap_symbol(self, operation: ast.AST, left: ast.AST, right: ast.AST) -> None:
        """Replace the operator between two nodes."""
        kind, symbol, other = SWAPPED_SYMBOLS.get(type(operation), ("", "", ""))
        between = self._source[self._end(left) : self._begin(right)].decode()
        match = re.search(rf"(?<![\w<>=!]){re.escape(symbol)}(?![\w<>=])", between) if symbol else None
        if match:
            begin = self._end(left) + len(between[: match.start()].encode())
            self._add_at(kind, begin, begin + len(symbol), other)

    # What stays.

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None: ...
    def visit_Raise(self, node: ast.Raise) -> None: ...
    def visit_Assert(self, node: ast.Assert) -> None: ...
    def visit_Import(self, node: ast.Import) -> None: ...
    def visit_ImportFrom(self, node: ast.ImportFrom) -> None: ...

    # Definitions.

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._names.append(node.name)
        inside, self._in_function = self._in_function, 0
        for line in node.body:
            self.visit(line)
        self._in_function = inside
        self._names.pop()

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        decorators = {ast.unparse(one).split(".")[-1] for one in node.decorator_list}
        if "overload" in decorators or node.name in ("__repr__", "__str__"):
            return
        self._names.append(node.name)
        outside = self._may_be_none
        returns = ast.unparse(node.returns) if node.returns else ""
        self._may_be_none = returns.endswith("| None") or returns.startswith("Optional[")
        for default in (*node.args.defaults, *node.args.kw_defaults):
            if default is not None:
                self.visit(default)
        self._in_function += 1
        for line in node.body:
            self.visit(line)
        self._in_function -= 1
        self._may_be_none = outside
        self._names.pop()

    visit_AsyncFunctionDef = visit_FunctionDef  # type: ignore[assignment]

    def visit_arg(self, node: ast.arg) -> None: ...

    def visit_Assign(self, node: ast.Assign) -> None:
        if self._in_function or not _is_declaration(node.value):
            for target in node.targets:
                self.visit(target)
            self.visit(node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None and (self._in_function or not _is_declaration(node.value)):
            self.visit(node.value)

    # Statements.

    def visit_If(self, node: ast.If) -> None:
        condition = ast.unparse(node.test)
        if condition in ("TYPE_CHECKING", "__name__ == '__main__'"):
            return
        self._negate(node.test)
        self.generic_visit(node)

    def visit_While(self, node: ast.While) -> None:
        if not isinstance(node.test, ast.Constant):
            self._negate(node.test)
            self.visit(node.test)
        for line in (*node.body, *node.orelse):
            self.visit(line)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._negate(node.test)
        self.generic_visit(node)

    def visit_comprehension(self, node: ast.comprehension) -> None:
        for condition in node.ifs:
            self._negate(condition)
        self.generic_visit(node)

    def _negate(self, condition: ast.expr) -> None:
        if not isinstance(condition, ast.UnaryOp | ast.NamedExpr):
            self._add("condition", condition, f"(not ({self._text(condition)}))")

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._add("statement", node, "pass")
        swap = SWAPPED_SYMBOLS.get(type(node.op))
        if swap and not _is_text(node.value):
            begin = self._end(node.target)
            place = self._source.index(swap[1].encode() + b"=", begin)
            self._add_at(swap[0], place, place + len(swap[1]), swap[2])
        self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant) or _is_log(node.value):
            return
        if isinstance(node.value, ast.Call):
            self._add("statement", node, "pass")
        self.generic_visit(node)

    def visit_Continue(self, node: ast.Continue) -> None:
        self._add("statement", node, "pass")

    def visit_Break(self, node: ast.Break) -> None:
        self._add("statement", node, "pass")

    def visit_Return(self, node: ast.Return) -> None:
        if node.value is None:
            return
        if self._may_be_none and not (isinstance(node.value, ast.Constant) and node.value.value is None):
            self._add("return", node.value, "None")
        self.visit(node.value)

    # Expressions.

    def visit_Compare(self, node: ast.Compare) -> None:
        left = node.left
        for operation, right in zip(node.ops, node.comparators, strict=True):
            self._swap_symbol(operation, left, right)
            left = right
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._swap_symbol(node.op, left, right)
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        is_path = isinstance(node.op, ast.Div) and any(
            PATH_NAMES.search(self._text(n)) for n in (node.left, node.right)
        )
        if not (_is_text(node.left) or _is_text(node.right) or is_path):
            self._swap_symbol(node.op, node.left, node.right)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.Not):
            self._add("not", node, f"({self._text(node.operand)})")
        elif isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
            self._add("sign", node, f"({self._text(node.operand)})")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self._add("flag", node, str(not value))
        elif isinstance(value, int):
            self._add("constant", node, str(value + 1))
            if value > 1:
                self._add("constant", node, str(value - 1))
        elif isinstance(value, float) and value == value and abs(value) < 1e300:
            self._add("constant", node, repr(2.0 * value) if value else "1.0")
            if value:
                self._add("sign", node, f"(-{self._text(node)})")

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.visit(node.value)
        index = node.slice
        if isinstance(index, ast.Name) and INDEX_NAMES.match(index.id):
            self._add("index", index, f"{index.id} + 1")
        for part in index.elts if isinstance(index, ast.Tuple) else (index,):
            if isinstance(part, ast.Slice):
                self._slice(part)
        self.visit(index)

    def _slice(self, part: ast.Slice) -> None:
        for bound in (part.lower, part.upper):
            if bound is not None and not isinstance(bound, ast.Constant):
                self._add("slice", bound, f"({self._text(bound)}) + 1")
        if part.lower is not None and part.upper is not None:
            self._add("slice", part.lower, "")
        if part.step is not None:
            self._add("slice", part.step, "")

    def visit_Call(self, node: ast.Call) -> None:
        if _is_log(node):
            return
        name = _last_name(node.func)
        if name in SWAPPED_NAMES:
            end = self._end(node.func)
            self._add_at("name", end - len(name), end, SWAPPED_NAMES[name])
        if name in REMOVED_CALLS and node.args:
            self._add("call", node, f"({self._text(node.args[0])})")
        if name == "sorted" and not any(word.arg == "reverse" for word in node.keywords):
            last = (*node.args, *node.keywords)[-1]
            self._add_at("order", self._end(last), self._end(last), ", reverse=True")
        self._swap_arguments(node, name)
        self.visit(node.func)
        for one in (*node.args, *node.keywords):
            self.visit(one)

    def _swap_arguments(self, node: ast.Call, name: str) -> None:
        if name in ("isinstance", "getattr", "setattr", "hasattr", "cast", "min", "max", "zip", "super"):
            return
        for left, right in zip(node.args, node.args[1:], strict=False):
            texts = self._text(left), self._text(right)
            plain = not any(isinstance(one, ast.Starred | ast.GeneratorExp) or _is_text(one) for one in (left, right))
            if plain and texts[0] != texts[1]:
                begin, end = self._begin(left), self._end(right)
                between = self._source[self._end(left) : self._begin(right)].decode()
                self._add_at("arguments", begin, end, f"{texts[1]}{between}{texts[0]}")


def _last_name(function: ast.expr) -> str:
    if isinstance(function, ast.Name):
        return function.id
    return function.attr if isinstance(function, ast.Attribute) else ""


def _is_log(node: ast.expr) -> bool:
    """True for calls like `log.info(...)`."""
    if not isinstance(node, ast.Call):
        return False
    names = [
        one.id if isinstance(one, ast.Name) else one.attr
        for one in ast.walk(node.func)
        if hasattr(one, "ctx") and isinstance(one, ast.Name | ast.Attribute)
    ]
    return any(LOGGERS.match(name) for name in names)


def _is_text(node: ast.expr) -> bool:
    """True for texts, bytes, and lists and tuples, which are joined by `+`."""
    if isinstance(node, ast.JoinedStr | ast.List | ast.Tuple | ast.ListComp):
        return True
    if isinstance(node, ast.BinOp):
        return _is_text(node.left) or _is_text(node.right)
    return isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)


def _is_declaration(value: ast.expr) -> bool:
    """True for literals and for the defaults of fields: they say what is, and compute nothing."""
    if isinstance(value, ast.Call):
        return _last_name(value.func) in ("field", "arg", "TypeVar", "NewType", "namedtuple", "Parameter")
    nodes = (ast.Constant, ast.Tuple, ast.List, ast.Dict, ast.Set, ast.UnaryOp, ast.Name, ast.Attribute, ast.Starred)
    return all(isinstance(node, (*nodes, ast.expr_context, ast.unaryop)) for node in ast.walk(value))
