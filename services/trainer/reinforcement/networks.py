"""Actor and critic: small networks of fully connected layers. Needs torch."""

import itertools
import math
from collections.abc import Sequence

from torch import nn

from readygo.common.arrays import Float32Array


def make_network(inputs: int, widths: Sequence[int], outputs: int, *, last_gain: float) -> nn.Sequential:
    """Layers with ReLU between them, orthogonal at first.

    Args:
        inputs: Numbers that it is told.
        widths: Sizes of the hidden layers.
        outputs: Numbers that it answers.
        last_gain: Scale of the last layer's weights at first.
    """
    sizes = [inputs, *widths, outputs]
    layers: list[nn.Module] = []
    for k, (size, following) in enumerate(itertools.pairwise(sizes)):
        linear = nn.Linear(size, following)
        nn.init.orthogonal_(linear.weight, last_gain if k == len(widths) else math.sqrt(2.0))
        nn.init.zeros_(linear.bias)
        layers += [linear, nn.ReLU()]
    return nn.Sequential(*layers[:-1])


def layers_of(network: nn.Sequential) -> list[tuple[Float32Array, Float32Array]]:
    """Weights, shape (outputs, inputs), and biases of each layer."""
    return [
        (layer.weight.detach().numpy().copy(), layer.bias.detach().numpy().copy())
        for layer in network
        if isinstance(layer, nn.Linear)
    ]
