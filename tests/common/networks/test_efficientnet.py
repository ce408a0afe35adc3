import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.networks import efficientnet  # noqa: E402


def test_padding_is_that_of_even_sizes_whatever_comes_in():
    with torch.device("meta"):
        stem = efficientnet.PaddedConv(3, 4, 3, 2)
        assert stem(torch.zeros(1, 3, 64, 85)).shape[2:] == (32, 42)
        wide = efficientnet.PaddedConv(3, 4, 5, 2)
        assert wide(torch.zeros(1, 3, 14, 14)).shape[2:] == (7, 7)
    assert stem._pad == (0, 1, 0, 1)
    assert wide._pad == (1, 2, 1, 2)
    assert efficientnet.PaddedConv(3, 4, 5, 1)._pad == (2, 2, 2, 2)


@pytest.mark.parametrize("norm", [efficientnet.batch_norm, efficientnet.group_norm])
def test_image_becomes_one_vector(norm):
    with torch.device("meta"):
        assert efficientnet.EfficientNet(6, norm)(torch.zeros(2, 6, 96, 96)).shape == (2, 1280)
