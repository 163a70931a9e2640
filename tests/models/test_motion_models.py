from itertools import pairwise

import numpy as np
import pytest

from slrl_sumo.models.motion_models import CACHED_ROWS, INPUT_LIMIT, Networks, outputs

COLUMNS, TYPES, MEMBERS = 7, 3, 2


def made(*sizes: int) -> Networks:
    """Networks with random weights and layers of these sizes."""
    rng = np.random.default_rng(1)

    def singles(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    pairs = list(pairwise(sizes))
    return Networks(
        singles(TYPES, COLUMNS),
        np.ones((TYPES, COLUMNS), np.float32),
        tuple(singles(TYPES, MEMBERS, *pair) for pair in pairs),
        tuple(singles(TYPES, MEMBERS, 1, last) for _, last in pairs),
    )


@pytest.mark.parametrize("sizes", [(COLUMNS, 32, 9, 2), (COLUMNS, 5, 16, 1)])
def test_outputs_are_those_of_each_road_user_alone_bit_for_bit(sizes: tuple[int, ...]) -> None:
    networks, rng = made(*sizes), np.random.default_rng(2)
    n = 2 * CACHED_ROWS + 13
    vector, kind = rng.normal(size=(n, COLUMNS + 1)).astype(np.float32), rng.integers(0, TYPES, n)
    together = outputs(networks, vector, kind)
    alone = np.concatenate([outputs(networks, vector[[row]], kind[[row]]) for row in range(n)])
    assert together.shape == (n, MEMBERS, sizes[-1])
    assert np.array_equal(together, alone)
    x = np.clip(vector[:, :COLUMNS] - networks.mean[kind], -INPUT_LIMIT, INPUT_LIMIT)[:, None]
    for number, (weight, bias) in enumerate(zip(networks.weight, networks.bias, strict=True)):
        x = np.einsum(
            "nmi,nmio->nmo", np.broadcast_to(np.tanh(x) if number else x, (n, MEMBERS, x.shape[2])), weight[kind]
        )
        x = x + bias[kind][:, :, 0]
    assert together == pytest.approx(x, abs=1e-4)


def test_without_road_users_there_are_no_outputs() -> None:
    none = outputs(made(COLUMNS, 8, 2), np.zeros((0, COLUMNS), np.float32), np.zeros(0, np.int64))
    assert none.shape == (0, MEMBERS, 2)
