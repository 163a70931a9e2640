"""Commands that measure traffic: evaluate, compare."""

from pathlib import Path
from typing import Annotated, Any

import typer

from slrl_sumo.cli.app import (
    BundleName,
    ExcludedIds,
    RayAddress,
    RegionText,
    Verbose,
    Workers,
    app,
    backend_of,
    claim,
    numbers,
    scenario_names,
)
from slrl_sumo.errors import InputError
from slrl_sumo.extras import require
from slrl_sumo.formats.output_files import Output
from slrl_sumo.models.bundle_folder import DEFAULT_BUNDLE

RESULTS = ("results.*", "comparison.html", "episodes.jsonl", "runs.jsonl", "conflicts.csv", "*.png")
"""What studies write into their folders."""
ALL_SHARES = "car=1,bicycle=1,pedestrian=1"


@app.command()
def evaluate(
    what: Annotated[
        str, typer.Argument(metavar="SCENARIO|FILE", help="Scenario as in `run`, or trajectories of a recording, .npz.")
    ],
    out: Annotated[Path, typer.Option(help="Folder to write: results.json, results.csv and more.")],
    bundle: BundleName = DEFAULT_BUNDLE,
    selectors: Annotated[
        str | None,
        typer.Option(
            help="Separated by commas. [default: FILE: all that the bundle allows; SCENARIO: sumo, prior and the "
            "trained ones]"
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of everything that is drawn at random.")] = 1,
    agents: Annotated[
        str | None, typer.Option(help="SCENARIO: learned road users, e.g. 16,32,64. [default: 32]")
    ] = None,
    episodes: Annotated[int | None, typer.Option(help="SCENARIO: per selector, agents and seed. [default: 64]")] = None,
    steps: Annotated[int | None, typer.Option(help="SCENARIO: decisions of 0.4 s. [default: 128]")] = None,
    seeds: Annotated[int | None, typer.Option(help="SCENARIO: seeds, from --seed on. [default: 1]")] = None,
    first: Annotated[
        int | None, typer.Option(help="SCENARIO: number of the first episode of each seed. [default: 0]")
    ] = None,
    workers: Workers = None,
    ray: RayAddress = None,
    recording: Annotated[Path | None, typer.Option(help="SCENARIO: trajectories to measure in the same way.")] = None,
    starts: Annotated[
        int | None, typer.Option(help="FILE: frames of 0.4 s between the starts of two rollouts. [default: 5]")
    ] = None,
    net: Annotated[
        Path | None,
        typer.Option(
            help="FILE: SUMO network in its coordinates, on which vehicles are expected to keep to their lanes, or "
            "Lanelet2 map, .osm. [default: everything is road]"
        ),
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option(
            help="FILE: where its (0, 0) m lies in a Lanelet2 map: utm:LAT,LON | mercator:LAT,LON | "
            "utm:EASTING,NORTHING. [default: m of the map, or utm:0,0]"
        ),
    ] = None,
    mask: Annotated[
        Path | None,
        typer.Option(help="FILE: instead a PNG: white road, yellow sidewalk, black nothing; upper left at 0, 0."),
    ] = None,
    metres_per_pixel: Annotated[float | None, typer.Option(help="FILE: resolution of --mask.")] = None,
    verbose: Verbose = False,
) -> None:
    """Measure selectors in a scenario, or prediction errors over 6.4 s on a recording."""
    is_file = what.endswith(".npz")
    names = None if selectors is None else tuple(name.strip() for name in selectors.split(","))
    scenario_options = {
        "episodes": episodes,
        "steps": steps,
        "seeds": seeds,
        "first": first,
        "recording": recording,
    }
    ground = (net, origin, mask, metres_per_pixel)
    file_options = dict(zip(("starts", "net", "origin", "mask", "metres-per-pixel"), (starts, *ground), strict=True))
    for option, value in (
        {"agents": agents, "workers": workers, "ray": ray, **scenario_options} if is_file else file_options
    ).items():
        if value is not None:
            kind, other = ("a recording", "a scenario") if is_file else ("a scenario", "a recording (.npz)")
            raise InputError(f"--{option} {value}: belongs to {other}, and {what} is {kind}; leave it out")
    claim(Output("out", out, RESULTS), inputs=[what, bundle, recording, net, mask], scenarios=[] if is_file else [what])
    if is_file:
        _evaluate_recording(what, bundle, out, names, 5 if starts is None else starts, seed, ground)
        return
    given: dict[str, Any] = {name: value for name, value in scenario_options.items() if value is not None}
    if agents is not None:
        given["agents"] = numbers("agents", agents)
    backend = backend_of(workers, ray)
    from slrl_sumo.studies.episodes.evaluate import EvaluationSettings, write_evaluation

    settings = EvaluationSettings(
        scenario=what, bundle=bundle, selectors=names or (), seed=seed, backend=backend, **given
    )
    interrupted_by = write_evaluation(settings, out)
    if interrupted_by:
        raise typer.Exit(128 + interrupted_by)


@app.command()
def compare(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO",
            help="Shipped name, folder or .sumocfg; with --traces also a network, .net.xml or .net.xml.gz.",
            autocompletion=scenario_names,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write: results.json, comparison.html and more.")],
    bundle: BundleName = DEFAULT_BUNDLE,
    takeover: Annotated[
        str, typer.Option(help="Shares of the scenario's own road users to take over. [default: all]")
    ] = ALL_SHARES,
    region: RegionText = None,
    exclude: ExcludedIds = None,
    selector: Annotated[
        str | None,
        typer.Option(
            help="prior, rule, greedy, sampled or lane. "
            "[default: greedy, or rule for a bundle without a trained selector]"
        ),
    ] = None,
    guard: Annotated[
        bool, typer.Option("--guard", help="Do not choose modes that run into a conflict where others are left.")
    ] = False,
    seeds: Annotated[int, typer.Option(help="Number of seeds, from --seed on; each is run twice.")] = 5,
    seed: Annotated[int, typer.Option(help="The first seed, of SUMO and of the choices.")] = 1,
    steps: Annotated[int | None, typer.Option(help="Decisions of 0.4 s. [default: to the scenario's end]")] = None,
    seconds: Annotated[float | None, typer.Option(help="Simulated time of a run, instead of --steps.")] = None,
    step_length: Annotated[float | None, typer.Option(help="SUMO's step, s; must divide 0.4.")] = None,
    workers: Workers = None,
    ray: RayAddress = None,
    traces: Annotated[
        tuple[Path, Path] | None,
        typer.Option(help="Run nothing: compare two traces (FCD) of the scenario, the second with the first."),
    ] = None,
    verbose: Verbose = False,
) -> None:
    """Run a scenario with SUMO's own models and with learned ones, or take two traces, and measure the differences."""
    if traces is not None:
        own: dict[str, Any] = {
            "bundle": bundle,
            "takeover": takeover,
            "region": region,
            "exclude": exclude or None,
            "selector": selector,
            "guard": guard,
            "seeds": seeds,
            "seed": seed,
        }
        own |= {"steps": steps, "seconds": seconds, "step-length": step_length, "workers": workers, "ray": ray}
        usual = {"bundle": DEFAULT_BUNDLE, "takeover": ALL_SHARES, "guard": False, "seeds": 5, "seed": 1}
        for option, value in own.items():
            if value != usual.get(option):
                raise InputError(f"--{option}: belongs to a comparison of runs, and --traces runs none; leave it out")
        _compare_traces(scenario, traces, out)
        return
    claim(Output("out", out, RESULTS), inputs=[bundle], scenarios=[scenario])
    require("matplotlib", "compare")
    backend = backend_of(workers, ray)
    from slrl_sumo.studies.compare.comparison import ComparisonSettings, write_compared

    settings = ComparisonSettings(
        scenario=scenario,
        bundle=bundle,
        takeover=takeover,
        region=region,
        exclude=",".join(exclude or ()),
        selector=selector,
        guard=guard,
        steps=steps,
        seconds=seconds,
        seed=seed,
        seeds=seeds,
        step_length=step_length,
        backend=backend,
    )
    interrupted_by = write_compared(settings, out)
    if interrupted_by:
        raise typer.Exit(128 + interrupted_by)


def _compare_traces(scenario: str, traces: tuple[Path, Path], out: Path) -> None:
    claim(Output("out", out, RESULTS), inputs=[*traces, scenario])
    require("matplotlib", "compare")
    from slrl_sumo.replay.vehicle_sizes import scenario_sizes
    from slrl_sumo.studies.compare.traces import write_compared_traces
    from slrl_sumo.sumo.net_file import find_net

    net, known = find_net(scenario, "")
    sizes, types = ({}, {}) if known is None else scenario_sizes(known)
    write_compared_traces(net, traces, out, types, sizes, known)


def _evaluate_recording(
    file: str,
    bundle: str,
    out: Path,
    selectors: tuple[str, ...] | None,
    starts: int,
    seed: int,
    ground: tuple[Path | None, str | None, Path | None, float | None],
) -> None:
    require("matplotlib", "evaluate of a recording")
    from slrl_sumo.formats.trajectory_file import load_trajectories
    from slrl_sumo.jobs.progress import progress
    from slrl_sumo.models.bundle import load_bundle
    from slrl_sumo.studies.prediction.evaluate import evaluate as measure
    from slrl_sumo.studies.prediction.given_ground import given_ground
    from slrl_sumo.studies.prediction.report import print_evaluation, write_evaluation

    recording, models = load_trajectories(file), load_bundle(bundle)
    roadmap, surface, routes = given_ground(recording, *ground)
    with progress() as bar:
        task = bar.add_task("rollouts", total=1.0)
        result = measure(
            recording,
            models,
            selectors=selectors,
            roadmap=roadmap,
            surface=surface,
            routes=routes,
            starts_every=starts,
            seed=seed,
            progress=lambda share: bar.update(task, completed=share),
        )
    write_evaluation(result, out)
    print_evaluation(result)
