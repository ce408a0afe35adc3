from pathlib import Path

import pytest

from tests.plain_words import Found, checked_files, find, instead_of, main, phrases_in


@pytest.mark.parametrize(
    ("text", "phrases"),
    [
        ("Whoever connects", ["Whoever"]),
        ("it goes on, and went on", ["goes on", "went on"]),
        ("a port of its own", ["of its own"]),
        ("a file in\n    place of another", ["in place of"]),
        ("body, ago one, renewed, anewer, placed", []),
    ],
)
def test_phrases_are_found_as_words_also_across_a_line_break(text: str, phrases: list[str]) -> None:
    assert [found.phrase for found in phrases_in(text)] == phrases


def test_line_is_where_the_phrase_begins() -> None:
    assert list(phrases_in("a\nb anew\nc nobody", first_line=10)) == [Found(11, "anew"), Found(12, "nobody")]


def test_comments_and_texts_of_a_source_are_read_and_names_are_not(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    path.write_text('"""By choice."""\nanew = 1  # anew\nwords = f"{path} goes on"\n')
    assert find(path) == [Found(1, "By choice"), Found(2, "anew"), Found(3, "goes on")]


def test_files_with_phrases_are_named_with_what_to_write(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "good.md").write_text("Every client continues.\n")
    (tmp_path / "bad.md").write_text("\nIt begins anew.\n")
    assert main([str(tmp_path / "good.md")]) == 0
    assert main([str(tmp_path / "bad.md")]) == 1
    assert f"{tmp_path / 'bad.md'}:2: 'anew': again" in capsys.readouterr().out
    assert instead_of("Goes on").startswith("continues")


def test_documents_and_product_are_read_and_tests_are_not() -> None:
    names = {str(path.relative_to(Path(__file__).resolve().parents[1])) for path in checked_files()}
    assert {"README.md", "docs/learn.md", "common/errors.py", "services/driver/README.md"} <= names
    assert not any(name.startswith("tests/") for name in names)
    assert "CHANGELOG.md" not in names


def test_some_phrases_are_found_in_documents_only(tmp_path: Path) -> None:
    for name, expected in (("a.md", [Found(1, "own motion")]), ("a.py", [])):
        (tmp_path / name).write_text('"""Learns from own motion."""\n')
        assert find(tmp_path / name) == expected
