"""The command bench: throughput of this machine, or flow of the traffic."""

from pathlib import Path
from typing import Annotated, Any

import typer

from slrl_sumo.cli.app import BundleName, RayAddress, Verbose, Workers, app, backend_of, claim, numbers
from slrl_sumo.cli.measure import RESULTS
from slrl_sumo.errors import InputError
from slrl_sumo.extras import require
from slrl_sumo.formats.output_files import Output
from slrl_sumo.models.bundle_folder import DEFAULT_BUNDLE


@app.command()
def bench(
    flow: Annotated[
        bool, typer.Option("--flow", help="Measure instead how traffic flows, beside SUMO's own models.")
    ] = False,
    json_file: Annotated[Path | None, typer.Option("--json", help="The table as JSON.")] = None,
    scenarios: Annotated[
        str | None,
        typer.Option(
            help="Shipped names, folders or .sumocfg, with commas. [default: intersection,shared-space,district]"
        ),
    ] = None,
    agents: Annotated[
        str | None, typer.Option(help="Learned road users, separated by commas. [default: 16,64,256,1024]")
    ] = None,
    cores: Annotated[
        str | None, typer.Option(help="Numbers of simulations side by side, e.g. 1,4. [default: 1 and all cores]")
    ] = None,
    threads: Annotated[
        str | None, typer.Option(help="Numbers of threads of each decision, e.g. 1,2. [default: 1]")
    ] = None,
    steps: Annotated[int | None, typer.Option(help="Measured decisions of each measurement. [default: 60]")] = None,
    bundle: BundleName = DEFAULT_BUNDLE,
    selector: Annotated[str | None, typer.Option(help="As in `run`. [default: the bundle's usual one]")] = None,
    mix: Annotated[
        str | None, typer.Option(help="Shares of types. [default: car=0.2,bicycle=0.2,pedestrian=0.6]")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of SUMO, the starting places and the choices.")] = 1,
    only: Annotated[
        str | None, typer.Option(help="--flow: situations, separated by commas. [default: all but the networks]")
    ] = None,
    networks: Annotated[
        bool, typer.Option("--networks", help="--flow: instead whole networks, which takes long.")
    ] = False,
    selectors: Annotated[
        str | None,
        typer.Option(
            help="--flow: separated by commas; with +guard behind the name with the guard. "
            "[default: all that the bundle can, but sampled]"
        ),
    ] = None,
    share: Annotated[
        float | None, typer.Option(help="--flow: share of the road users that are learned. [default: 1]")
    ] = None,
    seeds: Annotated[int | None, typer.Option(help="--flow: number of seeds, from --seed on. [default: 1]")] = None,
    out: Annotated[
        Path | None, typer.Option(help="--flow: folder to write: results.json, results.csv and more.")
    ] = None,
    workers: Workers = None,
    ray: RayAddress = None,
    verbose: Verbose = False,
) -> None:
    """Measure throughput on this machine, beside plain SUMO and the bare library calls; or, with --flow, traffic."""
    of_flow = {
        "only": only,
        "networks": networks or None,
        "selectors": selectors,
        "share": share,
        "seeds": seeds,
        "out": out,
        "workers": workers,
        "ray": ray,
    }
    of_throughput = {
        "json": json_file,
        "scenarios": scenarios,
        "agents": agents,
        "cores": cores,
        "threads": threads,
        "steps": steps,
        "selector": selector,
        "mix": mix,
    }
    for option, value in (of_throughput if flow else of_flow).items():
        if value is not None:
            reason = "belongs to a measurement of throughput; leave --flow out" if flow else "belongs to --flow; add it"
            raise InputError(f"--{option}: {reason}")
    if flow:
        _measure_flow(only, networks, selectors, bundle, share, seed, seeds, out, workers, ray)
        return
    given: dict[str, Any] = {name: value for name, value in (("steps", steps), ("mix", mix)) if value is not None}
    if scenarios is not None:
        given["scenarios"] = _names(scenarios)
    if agents is not None:
        given["agents"] = numbers("agents", agents)
    if cores is not None:
        given["cores"] = numbers("cores", cores)
    if threads is not None:
        given["threads"] = numbers("threads", threads)
    from slrl_sumo.studies.bench.bench import BenchSettings, write_bench

    settings = BenchSettings(bundle=bundle, selector=selector, seed=seed, **given)
    if json_file is not None:
        claim(Output("json", json_file), inputs=[bundle], scenarios=settings.scenarios)
    interrupted_by = write_bench(settings, json_file)
    if interrupted_by:
        raise typer.Exit(128 + interrupted_by)


def _measure_flow(
    only: str | None,
    networks: bool,
    selectors: str | None,
    bundle: str,
    share: float | None,
    seed: int,
    seeds: int | None,
    out: Path | None,
    workers: int | None,
    ray: str | None,
) -> None:
    require("matplotlib", "bench --flow")
    if out is not None:
        claim(Output("out", out, RESULTS), inputs=[bundle])
    backend = backend_of(workers, ray)
    from slrl_sumo.studies.flow.study import FlowSettings, write_measured_flow

    settings = FlowSettings(
        only=() if only is None else _names(only),
        networks=networks,
        selectors=() if selectors is None else _names(selectors),
        bundle=bundle,
        share=1.0 if share is None else share,
        seed=seed,
        seeds=1 if seeds is None else seeds,
        backend=backend,
    )
    interrupted_by = write_measured_flow(settings, out)
    if interrupted_by:
        raise typer.Exit(128 + interrupted_by)


def _names(text: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name.strip() for name in text.split(",")))
