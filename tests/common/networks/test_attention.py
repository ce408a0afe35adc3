import math

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.networks import attention  # noqa: E402


def test_places_are_encoded_as_sines_and_cosines():
    encoded = attention.PositionalEncoding(8, 5)(torch.zeros(1, 5, 8))[0]
    assert encoded[0].tolist() == [0.0, 1.0] * 4
    assert encoded[3, 0].item() == pytest.approx(math.sin(3))
    assert encoded[3, 3].item() == pytest.approx(math.cos(3 * 10000 ** (-2 / 8)))


def test_tokens_look_at_each_other():
    layers = attention.attention(attention.attention_layer(8, 16)).eval()
    tokens = torch.zeros(1, 3, 8)
    other = tokens.clone()
    other[0, 2, 0] = 1.0
    assert not torch.allclose(layers(tokens)[0, 0], layers(other)[0, 0])
