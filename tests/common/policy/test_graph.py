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
        ({"inputs": {"image": "rgb", "echo": "radar"}}, "radar"),
        ({"inputs": {"image": "rgb"}, "state": {"image": "h"}}, "image stands in more than one"),
        ({"inputs": {"image": "rgb"}, "rate_hz": 0.0}, "rate_hz must be"),
        ({"inputs": {"image": "rgb"}, "state": {"h": "h2"}}, "needs rate_hz"),
        ({"inputs": {"image": "rgb"}, "frame_count": 0}, "frame_count must be"),
        ({"inputs": {"image": "rgb", "rows": "window"}}, 'an input "window"'),
        ({"inputs": {"image": "rgb"}, "cache": {"latents": "latent"}}, 'an input "window"'),
        ({"inputs": {"image": "rgb", "row": "goal_frame"}}, '"goal_frame" goes with'),
        (
            {"inputs": {"image": "rgb", "w": "window", "g": "goal_image"}, "cache": {"latents": "latent"}},
            'takes the image of its goal as "goal_frame"',
        ),
    ],
)
def test_graphs_that_cannot_be_given_what_they_want_are_refused(mapping, words):
    with pytest.raises(ValueError, match=words):
        GraphSpec.from_mapping(mapping)


def test_graph_comes_back_from_plain_values():
    graph = GraphSpec(inputs={"x": "rgb", "goal": Given.GOAL_IMAGE}, state={"h": "h2"}, cache={}, rate_hz=15.0)
    assert GraphSpec.from_mapping(graph.to_mapping()) == graph
    assert GraphSpec.from_mapping(GraphSpec().to_mapping()) == GraphSpec()


def test_images_stand_camera_by_camera_however_the_graph_orders_its_inputs():
    inputs = {"a": "left.depth", "b": "depth", "c": "left.rgb", "d": "rgb", "e": "goal"}
    assert GraphSpec(inputs=inputs, cache={}).images == ("rgb", "depth", "left.rgb", "left.depth")


@pytest.mark.parametrize(("shape", "place"), [(("n", 4, 5, 3), (3, 2, 1)), (("n", 3, 4, 5), (1, 3, 2))])
def test_frames_that_are_encoded_alone_stand_side_by_side(shape, place):
    port = Port(np.uint8, shape)
    assert port.images(FRAMES, together=False)[1][place] == FRAMES[1, 3, 2, 1]
    assert port.images(FRAMES[:0], together=False).shape == (0, *shape[1:])


def test_cache_without_rows_has_the_graphs_width():
    port = Port(np.float32, ("known", 20))
    assert port.rows([]).shape == (0, 20)
    assert port.rows([np.ones(20, np.float32)] * 2).shape == (2, 20)
