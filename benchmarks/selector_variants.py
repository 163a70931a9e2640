"""How long the selector of a bundle takes for one decision of many road users, in different runtimes.

    python benchmarks/selector_variants.py [--bundle intersection] [--agents 64,1024] [--threads 1,2] [--rounds 40]

All variants are timed in turn, round after round, so that what disturbs the machine disturbs all alike; medians and
minima in ms, and the largest difference from eager PyTorch. Variants whose packages are missing are left out: ONNX
Runtime wants `onnxruntime`, `onnx` and `onnxscript`, torch.compile a C++ compiler.
docs/measurements/archive/performance.md holds the last results.
"""

import argparse
import io
import statistics
import warnings
from collections.abc import Callable
from time import perf_counter

import numpy as np
import torch
from torch import Tensor, nn

from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.policy import Policy, _normalised
from slrl_sumo.perception.ego_image import EGO_COLS, EGO_ROWS
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.perception.route_features import ROUTE_FEATURES

Inputs = tuple[Tensor, Tensor, Tensor, Tensor, Tensor]


class Dense(nn.Module):
    """The correction of a policy with the heads of all types for all road users. No step depends on the data, as
    tracing, export and compiling require."""

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, vector: Tensor, image: Tensor, kind: Tensor, rollouts: Tensor, route: Tensor) -> Tensor:
        """See Policy.correction."""
        policy = self.policy
        pixels = image.permute(0, 3, 1, 2).float() / 127.5 - 1.0
        seen = policy.trunk(
            torch.cat([policy.encoder(pixels), _normalised(vector, policy.config.vector_columns), route], -1)
        )
        rated = policy._rated(rollouts, vector)
        modes = torch.stack([actor(seen) for actor in policy.actors], 1)
        modes = modes + torch.stack([scorer(rated)[..., 0] for scorer in policy.scorers], 1)
        return (modes * nn.functional.one_hot(kind, modes.shape[1])[..., None]).sum(1)


def drawn(agents: int, policy: Policy) -> Inputs:
    """Observations of `agents` road users, of the sizes of real ones."""
    rng = torch.Generator().manual_seed(agents)
    kind = torch.randint(0, 3, (agents,), generator=rng)
    vector = torch.rand(agents, len(FEATURES), generator=rng) * 5.0
    vector[:, 2:5] = nn.functional.one_hot(kind, 3)
    image = torch.randint(0, 256, (agents, EGO_ROWS, EGO_COLS, 3), generator=rng, dtype=torch.uint8)
    rollouts = torch.rand(agents, policy.config.modes, len(policy.config.rollout_features), generator=rng)
    return vector, image, kind, rollouts, torch.rand(agents, len(ROUTE_FEATURES), generator=rng)


def variants(policy: Policy, inputs: Inputs) -> dict[str, Callable[[], Tensor]]:
    """The ways to run `policy` for `inputs` that this machine has, by name."""
    dense = Dense(policy).eval()
    found: dict[str, Callable[[], Tensor]] = {
        "eager, heads of the own type (what runs use)": lambda: policy.correction(*inputs),
        "eager, all heads and the value (training)": lambda: policy(*inputs)[0],
    }

    def attempt(name: str, make: Callable[[], Callable[[], Tensor]]) -> None:
        try:
            run = make()
            run()
        except Exception as error:  # a package or compiler that is missing, or a model that it cannot take
            print(f"left out: {name} ({type(error).__name__}: {str(error).splitlines()[0][:90]})")
        else:
            found[name] = run

    def script() -> Callable[[], Tensor]:
        traced = torch.jit.optimize_for_inference(torch.jit.freeze(torch.jit.trace(dense, inputs)))  # type: ignore[no-untyped-call]
        return lambda: traced(*inputs)

    def export() -> Callable[[], Tensor]:
        exported = torch.export.export(dense, inputs).module()
        return lambda: exported(*inputs)

    def compiled() -> Callable[[], Tensor]:
        quick = torch.compile(dense)
        return lambda: quick(*inputs)

    def quantised() -> Callable[[], Tensor]:
        small = torch.ao.quantization.quantize_dynamic(dense, {nn.Linear}, dtype=torch.qint8)  # type: ignore[no-untyped-call]
        return lambda: small(*inputs)

    def onnx() -> Callable[[], Tensor]:
        import onnxruntime  # type: ignore[import-not-found]

        file = io.BytesIO()
        names = ["vector", "image", "kind", "rollouts", "route"]
        torch.onnx.export(dense, inputs, file, input_names=names, dynamo=False)  # type: ignore[arg-type]
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = torch.get_num_threads()
        session = onnxruntime.InferenceSession(file.getvalue(), options, providers=["CPUExecutionProvider"])
        feed = {name: value.numpy() for name, value in zip(names, inputs, strict=True)}
        return lambda: torch.from_numpy(session.run(None, feed)[0])

    attempt("TorchScript, traced and frozen", script)
    attempt("torch.export", export)
    attempt("torch.compile", compiled)
    attempt("int8 (linear layers, dynamic)", quantised)
    attempt("ONNX Runtime", onnx)
    return found


def main() -> None:
    """Time all variants, print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bundle", default="intersection")
    parser.add_argument("--agents", default="64,1024")
    parser.add_argument("--threads", default="1,2")
    parser.add_argument("--rounds", type=int, default=40)
    arguments = parser.parse_args()
    policy = load_bundle(arguments.bundle).policy
    assert policy is not None, "this bundle has no trained selector"
    warnings.simplefilter("ignore")
    print("| agents | threads | variant | median (ms) | least (ms) | differs by |")
    print("|---|---|---|---|---|---|")
    for agents in map(int, arguments.agents.split(",")):
        inputs = drawn(agents, policy)
        for threads in map(int, arguments.threads.split(",")):
            torch.set_num_threads(threads)
            # Not inference_mode: what TorchScript froze outside cannot be run there.
            with torch.no_grad():
                ways = variants(policy, inputs)
                truth = policy.correction(*inputs)
                times: dict[str, list[float]] = {name: [] for name in ways}
                for _ in range(arguments.rounds):
                    for name, run in ways.items():
                        begin = perf_counter()
                        run()
                        times[name].append(1e3 * (perf_counter() - begin))
                for name, run in ways.items():
                    off = float(np.abs((run() - truth).numpy()).max())
                    middle, least = statistics.median(times[name]), min(times[name])
                    print(f"| {agents} | {threads} | {name} | {middle:.2f} | {least:.2f} | {off:.1g} |", flush=True)


if __name__ == "__main__":
    main()
