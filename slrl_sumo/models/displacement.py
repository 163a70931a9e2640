"""Displacement models: the motion of a road user of one type and mode in the next decision interval."""

import torch
from torch import Tensor, nn

from slrl_sumo.models.motion_models import MODES, SPEED, motion_models, motions
from slrl_sumo.models.stacked_networks import StackedNetworks
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

__all__ = ["MODES", "SPEED", "DisplacementModels", "displacement", "new_speed"]


def new_speed(speed: Tensor, acceleration: Tensor, max_speed: Tensor) -> Tensor:
    """Speed (m/s) after one decision interval, as in `slrl_sumo.scene.advance`."""
    return torch.minimum((speed + acceleration * DECISION_INTERVAL).clamp_min(0.0), max_speed)


def displacement(speed: Tensor, acceleration: Tensor, yaw_rate: Tensor, max_speed: Tensor) -> Tensor:
    """Displacement (..., 2) in m, in the ego frame of the interval's start, of one decision interval.

    The differentiable twin of `slrl_sumo.scene.advance.advance`; all arguments (...,), in m/s, m/s², rad/s, m/s.
    """
    distance = new_speed(speed, acceleration, max_speed) * DECISION_INTERVAL
    middle = 0.5 * yaw_rate * DECISION_INTERVAL
    return torch.stack([distance * middle.cos(), distance * middle.sin()], -1)


class DisplacementModels(nn.Module):
    """One small network per road user type and mode (paper, section 3.1), with bounded kinematics as output.

    The paper regresses the displacement without bounds, which diverges in closed loop. Here a network outputs
    acceleration and yaw rate through tanh, scaled to the recorded range of its type, and `advance` computes the
    displacement. The bounds are buffers, by type:

    acceleration_bounds, yaw_rate_bounds: (3, 2) lowest <= 0 and highest >= 0, m/s² and rad/s.
    max_curvature: (3,) 1/m, greatest turn per metre, so that standing road users do not turn: recorded headings are
        constant at a stand, and models that never learned to turn on the spot would spin.
    max_speed: (3,) m/s.
    """

    acceleration_bounds: Tensor
    yaw_rate_bounds: Tensor
    max_curvature: Tensor
    max_speed: Tensor

    def __init__(self, modes: int = MODES, hidden: tuple[int, ...] = (32, 32), inputs: int = len(FEATURES)) -> None:
        super().__init__()
        types = len(RoadUserType)
        self.networks = StackedNetworks(modes, hidden, 2, inputs)
        self.register_buffer("acceleration_bounds", torch.zeros(types, 2))
        self.register_buffer("yaw_rate_bounds", torch.zeros(types, 2))
        self.register_buffer("max_curvature", torch.zeros(types))
        self.register_buffer("max_speed", torch.zeros(types))

    def motion(self, vector: Tensor, kind: Tensor, mode: Tensor) -> tuple[Tensor, Tensor]:
        """Acceleration (m/s²) and yaw rate (rad/s), each (n,), of road users that follow the given modes.

        `vector`: (n, 12) feature vectors; `kind`: (n,) int64 RoadUserType; `mode`: (n,) int64 in 0..modes-1.
        """
        acceleration, yaw_rate = self.motion_blocks(vector[:, None], kind, mode)
        return acceleration[:, 0], yaw_rate[:, 0]

    def motion_blocks(self, vector: Tensor, kind: Tensor, mode: Tensor) -> tuple[Tensor, Tensor]:
        """`motion` for n blocks of rows that share type and mode: `vector` (n, rows, 12), results (n, rows)."""
        return self._bounded(self.networks(vector, kind, mode), vector[..., SPEED], kind)

    def motion_all(self, vector: Tensor, kind: Tensor) -> tuple[Tensor, Tensor]:
        """`motion` for every mode of the road user's type: acceleration and yaw rate, each (n, modes).

        For decisions, not for training: without gradients, on the processor.
        """
        weights = {name: tensor.detach().numpy() for name, tensor in self.state_dict().items()}
        acceleration, yaw_rate = motions(motion_models(weights), vector.numpy(), kind.numpy())
        return torch.from_numpy(acceleration), torch.from_numpy(yaw_rate)

    def _bounded(self, raw: Tensor, speed: Tensor, kind: Tensor) -> tuple[Tensor, Tensor]:
        """Raw outputs (n, m, 2) as bounded acceleration and yaw rate (n, m); `speed` broadcasts to (n, m)."""
        acceleration = _within(raw[..., 0], self.acceleration_bounds[kind][:, None])
        # Curvature bounds the turn per distance, so that the speed of the next interval counts.
        after = new_speed(speed, acceleration, self.max_speed[kind][:, None]).detach()
        turn = (self.max_curvature[kind][:, None] * after)[..., None]
        bounds = self.yaw_rate_bounds[kind][:, None].expand(*after.shape, 2)
        bounds = torch.maximum(torch.minimum(bounds, turn), -turn)
        return acceleration, _within(raw[..., 1], bounds)


def _within(raw: Tensor, bounds: Tensor) -> Tensor:
    """tanh of `raw` (n, m), scaled so that -1, 0 and 1 become lowest bound, 0 and highest bound; bounds (..., 2)."""
    unit = torch.tanh(raw)
    return torch.where(unit > 0, unit * bounds[..., 1], -unit * bounds[..., 0])
