"""The network of a forward model: its weights, its outputs, and its part of a checkpoint."""

import numpy as np
from numpy.typing import NDArray

# Rows per pass through the network: enough for fast products, few enough for the cache.
_CHUNK_ROWS = 4096

Weights = tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]
"""Matrix, shape [in, out], and offset, shape [out], of each layer."""


def network_outputs(inputs: NDArray[np.float32], weights: Weights) -> NDArray[np.float64]:
    """Return the outputs of a network.

    Args:
        inputs: Normalised features, shape [row, feature].
        weights: Matrix and offset of each layer.

    Returns:
        Normalised outputs, shape [row, output].
    """
    outputs = np.empty((len(inputs), len(weights[-1][1])))
    for start in range(0, len(inputs), _CHUNK_ROWS):
        hidden = inputs[start : start + _CHUNK_ROWS]
        for layer, (matrix, offset) in enumerate(weights):
            hidden = hidden @ matrix + offset
            if layer < len(weights) - 1:
                # Far below zero exp overflows to infinity, and SiLU is then zero as it should.
                with np.errstate(over="ignore"):
                    hidden /= 1.0 + np.exp(-hidden)
        outputs[start : start + _CHUNK_ROWS] = hidden
    return outputs


def weight_tensors(weights: Weights) -> dict[str, NDArray]:
    """Return weights by name, as a checkpoint holds them."""
    tensors: dict[str, NDArray] = {}
    for k, (matrix, offset) in enumerate(weights):
        tensors |= {f"layer{k}.matrix": matrix, f"layer{k}.offset": offset}
    return tensors


def weights_of_tensors(tensors: dict[str, NDArray]) -> Weights:
    """Return the weights among the arrays of a checkpoint.

    Raises:
        KeyError: A layer is missing.
    """
    layer_count = sum(name.endswith(".matrix") for name in tensors)
    return tuple(
        (tensors[f"layer{k}.matrix"], tensors[f"layer{k}.offset"]) for k in range(layer_count)
    )
