import numpy as np
import pytest

from readygo.common.messages.checks import check_array


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
