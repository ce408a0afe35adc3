from pathlib import Path

import pytest

from tests import mirror

CONSTANTS = '"""Constants."""\n\nimport math\n\nRATE_HZ = 20\nHALF = math.pi / 2\n'
PROTOCOL = 'class Eyes(Protocol):\n    def look(self) -> Image:\n        """An image."""\n        ...\n'
MESSAGE = "@dataclass(frozen=True)\nclass Reply:\n    rgb: Array\n"
SETTINGS = "@dataclass\nclass Config:\n    a: int = 1\n\n    def __post_init__(self):\n        check(self.a)\n"
NESTED = "class A:\n    class B:\n        def f(self):\n            return 1\n"
LAMBDA = "KEYS = {name: lambda x: x + 1 for name in NAMES}\n"


@pytest.mark.parametrize("source", [CONSTANTS, PROTOCOL, MESSAGE, ""])
def test_no_test_is_asked_of_declarations(source):
    assert mirror.is_exempt("y.py", source)


@pytest.mark.parametrize("source", [SETTINGS, NESTED, LAMBDA])
def test_a_test_is_asked_of_whatever_does_something(source):
    assert not mirror.is_exempt("y.py", source)
    for name in ("__init__.py", "__main__.py", "readygo_pb2.py"):
        assert mirror.is_exempt(name, source)


def test_test_of_a_module_lies_at_the_mirrored_path():
    assert mirror.mirrored(Path("common/x/y.py")) == Path("tests/common/x/test_y.py")


def test_module_without_a_test_is_named(tmp_path, monkeypatch, capsys):
    for name in ("common/a.py", "common/b.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(SETTINGS)
    (tmp_path / "tests" / "common").mkdir(parents=True)
    (tmp_path / "tests" / "common" / "test_a.py").touch()
    monkeypatch.setattr(mirror, "ROOT", tmp_path)
    assert mirror.main() == 1
    assert capsys.readouterr().err == "common/b.py: has no test at tests/common/test_b.py\n"
    (tmp_path / "tests" / "common" / "test_b.py").touch()
    assert mirror.main() == 0
    assert capsys.readouterr().err == ""
