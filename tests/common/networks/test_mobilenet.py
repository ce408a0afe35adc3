import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.networks import mobilenet  # noqa: E402


def test_features_are_a_thirty_second_of_the_image():
    with torch.device("meta"):
        features = mobilenet.mobilenet_features(18)(torch.zeros(1, 18, 64, 85))
    assert features.shape == (1, 1280, 2, 3)


def test_block_adds_what_came_in_where_shapes_allow():
    block = mobilenet.InvertedResidual(8, 8, 1, 6).eval()
    for parameter in block.conv[-1].parameters():
        torch.nn.init.zeros_(parameter)
    x = torch.randn(1, 8, 4, 4)
    assert torch.equal(block(x), x)
    assert mobilenet.InvertedResidual(8, 16, 2, 6).eval()(x).shape == (1, 16, 2, 2)
