import pytest

from tests.mutants.operators import find_mutations


def changes(source):
    """(operator, line after) of all changes that compile."""
    source = source.encode()
    return {(one.operator, one.after) for one in find_mutations("a.py", source) if one.compiles(source)}


def in_function(line):
    """Changes of a line in a function."""
    return changes(f"def f(a, b, i, x):\n    {line}\n")


@pytest.mark.parametrize(
    ("line", "operator", "after"),
    [
        ("return a < b", "boundary", "return a <= b"),
        ("return a>=b", "boundary", "return a>b"),
        ("return (a) == (b)", "equality", "return (a) != (b)"),
        ("return 0 < a < b", "boundary", "return 0 < a <= b"),
        ("return a + b", "arithmetic", "return a - b"),
        ("return a / b", "arithmetic", "return a * b"),
        ("a -= b", "arithmetic", "a += b"),
        ("a -= b", "statement", "pass"),
        ("return a and b or x", "and/or", "return a or b or x"),
        ("return not a", "not", "return (a)"),
        ("return -a", "sign", "return (a)"),
        ("return 3", "constant", "return 4"),
        ("return 3", "constant", "return 2"),
        ("return 0.5", "constant", "return 1.0"),
        ("return 0.5", "sign", "return (-0.5)"),
        ("return b(x, flag=True)", "flag", "return b(x, flag=False)"),
        ("return a(b, x)", "arguments", "return a(x, b)"),
        ("return min(a, b)", "name", "return max(a, b)"),
        ("return x.any()", "name", "return x.all()"),
        ("return abs(a - b)", "call", "return (a - b)"),
        ("return sorted(a)", "order", "return sorted(a, reverse=True)"),
        ("return x[i]", "index", "return x[i + 1]"),
        ("return x[a:b]", "slice", "return x[a:(b) + 1]"),
        ("return x[::-1]", "slice", "return x[::]"),
        ("return a if b else x", "condition", "return a if (not (b)) else x"),
        ("return [a for a in b if x]", "condition", "return [a for a in b if (not (x))]"),
        ("a.append(b)", "statement", "pass"),
    ],
)
def test_each_kind_of_change(line, operator, after):
    assert (operator, after) in in_function(line)


@pytest.mark.parametrize(
    "line",
    [
        '"""Text of 3."""',
        'return f"{a + 1}"',
        'return "a" + b',
        'log.info("%d", a + 1)',
        "raise ValueError(a + 1)",
        "assert a < b",
        "return folder / a",
        "from x import y",
    ],
)
def test_texts_errors_and_assertions_stay(line):
    assert in_function(line) == set()


@pytest.mark.parametrize(
    "source",
    [
        "RATE = 3\n",
        "NAMES = {'a': (1, 2.0)}\n",
        "class A:\n    x: float = 3.0\n    y: list = field(default_factory=list, hash=False)\n",
        "@cache(size=3)\ndef f(a: Literal[3]) -> Literal[3]:\n    return a\n",
        "if TYPE_CHECKING:\n    import a\n",
        "class A:\n    def __repr__(self):\n        return 1 + 2\n",
    ],
)
def test_declarations_decorators_and_annotations_stay(source):
    assert changes(source) == set()


def test_computed_constants_and_defaults_of_arguments_are_changed():
    assert ("arithmetic", "HALF = PI * 2") in changes("HALF = PI / 2\n")
    assert ("flag", "def f(a=False):") in changes("def f(a=True):\n    return a\n")


def test_none_is_returned_where_the_type_allows_it():
    def optional(returns):
        return ("return", "return None") in changes(f"def f(a) -> {returns}:\n    return a\n")

    assert optional("int | None")
    assert not optional("int")


def test_breaks_out_of_loops_are_removed():
    found = changes("def f(a):\n    for b in a:\n        if b:\n            continue\n        break\n")
    assert found >= {("statement", "pass")}
    assert len([one for one in find_mutations("a.py", b"for a in b:\n    break\n") if one.operator == "statement"]) == 1


def test_all_other_bytes_stay_as_they_are():
    source = "def f(a):\n    é = 'é'; b = (a  +  # plus\n        1)\n    return b\n".encode()
    (change,) = [one for one in find_mutations("a.py", source) if one.operator == "arithmetic"]
    assert change.apply(source) == source.replace(b"  +  #", b"  -  #")
    assert (change.line, change.function) == (2, "f")
