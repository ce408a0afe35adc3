import numpy as np
import pytest

from readygo.common.messages.checks import (
    NAME_MAX,
    check_array,
    check_printable,
    check_relative_path,
    check_sha256,
)


@pytest.mark.parametrize("shape", [(4, 3), (None, 3), (None, None)])
def test_array_of_the_right_type_and_shape_passes(shape: tuple[int | None, ...]) -> None:
    check_array("xyz", np.zeros((4, 3), np.float32), np.float32, shape)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((4, 3)), r"xyz must be float32 of shape \(None, 3\), got float64 \(4, 3\)\."),
        (np.zeros(3, np.float32), r"xyz must be float32 of shape \(None, 3\), got float32 \(3,\)\."),
        ([[0.0, 0.0, 0.0]], r"xyz must be float32 of shape \(None, 3\), got list\."),
        (np.zeros((4, 2), np.float32), r"xyz must have shape \(None, 3\), got \(4, 2\)\."),
    ],
)
def test_other_values_are_refused_in_words(array: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        check_array("xyz", array, np.float32, (None, 3))


@pytest.mark.parametrize("name", ["desk-1", "[/x]", "Zoë's desk", "a" * NAME_MAX])
def test_printable_names_pass(name: str) -> None:
    check_printable("name", name)
    check_printable("name", "", empty=True)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("", "name must not be empty"),
        ("\x1b[2J", r"printable characters, got '\\x1b\[2J'\."),
        ("\x1b]0;title\x07", "printable characters"),
        ("\x9b2J", "printable characters"),
        ("two\nlines", "printable characters"),
        ("\u202eright to left", "printable characters"),
        ("a" * (NAME_MAX + 1), "at most 200"),
    ],
)
def test_names_that_steer_a_terminal_are_refused(name: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        check_printable("name", name)


@pytest.mark.parametrize("text", ["", "a", "a" * 63, "a" * 65, "A" * 64, "g" * 64, "a" * 64 + "\n", "/etc", "../../.."])
def test_text_that_is_no_sha256_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"scene_hash must be 64 hexadecimal digits, got"):
        check_sha256("scene_hash", text)
    if text:
        with pytest.raises(ValueError, match=r"policy must be empty or 64 hexadecimal digits"):
            check_sha256("policy", text, empty=True)


def test_sha256_may_be_empty_where_that_is_said() -> None:
    check_sha256("policy", "", empty=True)
    check_sha256("policy", "0123456789abcdef" * 4)


@pytest.mark.parametrize(
    "path",
    ["", "/", "/etc/cron.d/evil", "..", "../x", "a/../b", "a/..", "./a", "a//b", "a/", "a\\b", "a\0b", "a" * 1001],
)
def test_path_that_leaves_its_folder_is_refused(path: str) -> None:
    with pytest.raises(ValueError, match=r"path must be a path within a folder, got"):
        check_relative_path("path", path)


@pytest.mark.parametrize("path", ["scene.ply", "maps/robot.yaml", ".hidden", "a..b", "Anna Maria é.npz", "a" * 1000])
def test_path_within_a_folder_is_taken(path: str) -> None:
    check_relative_path("path", path)
