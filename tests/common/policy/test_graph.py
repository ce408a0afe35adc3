import numpy as np
import pytest

from readygo.common.policy.graph import Given, GraphSpec, Port

FRAMES = np.arange(2 * 4 * 5 * 3, dtype=np.uint8).reshape(2, 4, 5, 3)


@pytest.mark.parametrize(
    ("shape", "place"),
    [
        ((1, 4, 5, 6), lambda image: image[0, 3, 2, 4]),
        ((1, 6, 4, 5), lambda image: image[0, 4, 3, 2]),
        ((1, 2, 4, 5, 3), lambda image: image[0, 1, 3, 2, 1]),
        (("batch", 2, 3, 4, 5), lambda image: image[0, 1, 1, 3, 2]),
    ],
)
def test_frames_are_laid_out_as_the_graph_has_them(shape, place):
    as_bytes, as_numbers = Port(np.uint8, shape).images(FRAMES), Port(np.float32, shape).images(FRAMES)
    assert as_bytes.shape[1:] == shape[1:]
    assert place(as_bytes) == FRAMES[1, 3, 2, 1]
    assert place(as_numbers) == pytest.approx(FRAMES[1, 3, 2, 1] / 255)


def test_states_begin_with_zeros_of_the_graphs_shape():
    zeros = Port(np.float32, (2, "batch", 64)).zeros()
    assert (zeros.shape, zeros.dtype, zeros.any()) == ((2, 1, 64), np.float32, np.False_)


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"inputs": {"goal": "goal"}}, 'must be "rgb"'),
        ({"inputs": {"image": "radar"}}, "radar"),
        ({"inputs": {"image": "rgb"}, "state": {"image": "h"}}, "image stands in"),
        ({"inputs": {"image": "rgb"}, "rate_hz": 0.0}, "rate_hz must be"),
    ],
)
def test_graphs_that_cannot_be_given_what_they_want_are_refused(mapping, words):
    with pytest.raises(ValueError, match=words):
        GraphSpec.from_mapping(mapping)


def test_graph_comes_back_from_plain_values():
    graph = GraphSpec(inputs={"image": Given.RGB, "goal": Given.GOAL_IMAGE}, state={"h": "h2"}, rate_hz=15.0)
    assert GraphSpec.from_mapping(graph.to_mapping()) == graph
