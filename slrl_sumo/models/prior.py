"""The prior: which mode people chose in the recordings, given what the vector says."""

from torch import Tensor, nn

from slrl_sumo.models.displacement import MODES
from slrl_sumo.models.stacked_networks import StackedNetworks
from slrl_sumo.perception.features import FEATURES


class Prior(nn.Module):
    """Mode classifier per road user type: the paper's supervised baseline for the selector (section 4.1)."""

    def __init__(self, modes: int = MODES, hidden: tuple[int, ...] = (64, 64), inputs: int = len(FEATURES)) -> None:
        super().__init__()
        self.networks = StackedNetworks(1, hidden, modes, inputs)

    def logits(self, vector: Tensor, kind: Tensor) -> Tensor:
        """Unnormalised log probabilities (n, modes); `vector` (n, inputs) feature vectors, `kind` (n,) int64 types."""
        logits: Tensor = self.networks.forward_all(vector, kind)[:, 0]
        return logits
