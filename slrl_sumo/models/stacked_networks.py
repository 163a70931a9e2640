"""Many small networks of one shape, evaluated as batched products."""

from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from slrl_sumo.models.motion_models import INPUT_LIMIT
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.scene.types import RoadUserType


class StackedNetworks(nn.Module):
    """`members` multilayer perceptrons for each road user type, with tanh between their layers.

    Layer l of all of them is one tensor: weight (types, members, in, out) and bias (types, members, 1, out).
    Inputs are feature vectors (slrl_sumo.perception.features); they are standardised per type by the buffers `mean`
    and `scale` (types, in), where `scale` is 1 / standard deviation. Columns that never varied in training have
    scale 0: what such a column does was never learned, so it has no say.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, members: int, hidden: tuple[int, ...], outputs: int, inputs: int = len(FEATURES)) -> None:
        super().__init__()
        types = len(RoadUserType)
        sizes = (inputs, *hidden, outputs)
        self.members = members
        pairs = list(pairwise(sizes))
        self.weight = nn.ParameterList([nn.Parameter(torch.zeros(types, members, a, b)) for a, b in pairs])
        self.bias = nn.ParameterList([nn.Parameter(torch.zeros(types, members, 1, b)) for _, b in pairs])
        self.register_buffer("mean", torch.zeros(types, inputs))
        self.register_buffer("scale", torch.ones(types, inputs))

    @torch.no_grad()
    def initialise(self, generator: torch.Generator) -> None:
        """Draw the weights uniformly from ±1/sqrt(inputs); biases and the last layer are 0, so all outputs are."""
        for weight, bias in zip(self.weight, self.bias, strict=True):
            reach = weight.shape[-2] ** -0.5
            weight.uniform_(-reach, reach, generator=generator)
            bias.zero_()
        self.weight[-1].zero_()

    def standardised(self, vector: Tensor, kind: Tensor) -> Tensor:
        """Feature vectors (n, in) or (n, rows, in) of the types `kind` (n,), standardised and kept within ±LIMIT; of
        more columns, which a selector may read, the first ones."""
        vector = vector[..., : self.mean.shape[1]]
        mean, scale = self.mean.index_select(0, kind), self.scale.index_select(0, kind)
        if vector.dim() > mean.dim():
            mean, scale = mean[:, None], scale[:, None]
        return ((vector - mean) * scale).clamp(-INPUT_LIMIT, INPUT_LIMIT)

    def forward(self, vector: Tensor, kind: Tensor, member: Tensor) -> Tensor:
        """Outputs (n, rows, out) of one chosen network for each of n blocks of rows.

        `vector`: (n, rows, in) feature vectors; `kind`: (n,) int64 types; `member`: (n,) int64, which network.
        """
        x = self.standardised(vector, kind)
        chosen = kind * self.members + member
        for layer, (weight, bias) in enumerate(zip(self.weight, self.bias, strict=True)):
            x = _tanh(x) if layer else x
            x = torch.baddbmm(
                bias.flatten(0, 1).index_select(0, chosen), x, weight.flatten(0, 1).index_select(0, chosen)
            )
        return x

    def forward_all(self, vector: Tensor, kind: Tensor) -> Tensor:
        """Outputs (n, members, out) of all networks of each row's type; `vector` (n, in), `kind` (n,) int64."""
        order = torch.argsort(kind)
        x = self.standardised(vector, kind).index_select(0, order)
        *inner, last = list(zip(self.weight, self.bias, strict=True))
        results = [x.new_empty(0, self.members, last[0].shape[-1])]
        counts = torch.bincount(kind, minlength=len(RoadUserType)).tolist()
        for one, rows in enumerate(torch.split(x, counts)):
            if len(rows):
                y = rows.expand(self.members, -1, -1)
                for weight, bias in inner:
                    y = _tanh(torch.baddbmm(bias[one], y, weight[one]))
                # Outputs are few: with rows as columns their product takes half the time.
                weight, bias = last[0][one].transpose(1, 2), last[1][one].transpose(1, 2)
                results.append(torch.baddbmm(bias, weight, y.transpose(1, 2)).permute(2, 0, 1))
        return torch.cat(results).index_select(0, torch.argsort(order))


def _tanh(x: Tensor) -> Tensor:
    """tanh of what is needed no more; numpy's takes a quarter of the time of torch's where nothing is to be learned."""
    if torch.is_grad_enabled() or x.device.type != "cpu":
        return torch.tanh(x)
    return torch.from_numpy(np.tanh(x.numpy(), out=x.numpy()))
