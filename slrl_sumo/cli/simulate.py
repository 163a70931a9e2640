"""Commands that run SUMO: run, generate, record, doctor."""

from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from slrl_sumo.cli.app import (
    BundleName,
    ExcludedIds,
    RayAddress,
    RegionText,
    ScenarioName,
    Verbose,
    Workers,
    app,
    backend_of,
    claim,
)
from slrl_sumo.cli.config import use_config
from slrl_sumo.errors import InputError
from slrl_sumo.formats.output_files import Output, write_json
from slrl_sumo.models.bundle_folder import DEFAULT_BUNDLE


@app.command()
def run(
    scenario: ScenarioName,
    agents: Annotated[int | None, typer.Option(help="Learned road users to spawn.")] = None,
    mix: Annotated[str | None, typer.Option(help="Shares, e.g. car=0.5,bicycle=0.2,pedestrian=0.3.")] = None,
    takeover: Annotated[
        str | None, typer.Option(help="Shares of the scenario's own road users to take over: car=0.3,pedestrian=1.")
    ] = None,
    region: RegionText = None,
    exclude: ExcludedIds = None,
    bundle: BundleName = DEFAULT_BUNDLE,
    selector: Annotated[
        str | None,
        typer.Option(
            help="Chooses the modes: prior, rule, greedy or sampled; or lane: the baseline without models. "
            "[default: greedy, or rule for a bundle without a trained selector]"
        ),
    ] = None,
    guard: Annotated[
        bool, typer.Option("--guard", help="Do not choose modes that run into a conflict where others are left.")
    ] = False,
    without: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Switch off a rule that is not learned, e.g. deadlock_release; may be given several times.",
        ),
    ] = None,
    steps: Annotated[
        int | None,
        typer.Option(help="Decisions of 0.4 s. [default: to the scenario's end, or until its road users have left]"),
    ] = None,
    until: Annotated[float | None, typer.Option(help="Simulation time to stop at, s.")] = None,
    seed: Annotated[int, typer.Option(help="Of SUMO, the starting places and the choices.")] = 1,
    step_length: Annotated[float | None, typer.Option(help="SUMO's step, s; must divide 0.4.")] = None,
    fcd: Annotated[
        Path | None, typer.Option(help="Trace: .xml, .xml.gz, .csv or .parquet; the last two with modes.")
    ] = None,
    summary: Annotated[Path | None, typer.Option(help="Summary as JSON.")] = None,
    report: Annotated[Path | None, typer.Option(help="Folder for report.html and its pictures.")] = None,
    recording: Annotated[
        Path | None,
        typer.Option(help="Trajectories, .npz, that the report compares with. [default: SUMO's own road users]"),
    ] = None,
    background_yields: Annotated[
        bool, typer.Option("--yield/--no-yield", help="Whether background traffic yields to learned road users.")
    ] = True,
    threads: Annotated[
        int, typer.Option(help="Threads of each decision, for many road users on free cores; results are the same.")
    ] = 1,
    sumo_outputs: Annotated[
        bool, typer.Option("--sumo-outputs", help="Let the scenario write its own output files.")
    ] = False,
    sumo_options: Annotated[str, typer.Option(help='Options for SUMO, e.g. "--lateral-resolution 0.8".')] = "",
    gui: Annotated[bool, typer.Option("--gui", help="Open sumo-gui, which needs a display.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
    config: Annotated[
        Path | None,
        typer.Option(
            help="Options from a TOML file, or from the summary of a run to repeat it; those given here have priority.",
            callback=use_config,
            is_eager=True,
        ),
    ] = None,
    verbose: Verbose = False,
) -> None:
    """Run learned road users in a scenario and write trace, summary and report."""
    from slrl_sumo.simulation.settings import RunSettings

    settings = RunSettings(
        scenario=scenario,
        agents=agents,
        bundle=bundle,
        selector=selector,
        mix=mix,
        takeover=takeover,
        region=region,
        exclude=",".join(exclude or ()),
        guard=guard,
        without=tuple(without or ()),
        steps=steps,
        until=until,
        seed=seed,
        step_length=step_length,
        background_yields=background_yields,
        threads=threads,
        sumo_outputs=sumo_outputs,
        sumo_options=sumo_options,
        gui=gui,
    )
    from slrl_sumo.api.run import write_run
    from slrl_sumo.cli.run_table import print_summary

    try:
        result = write_run(settings, fcd=fcd, summary=summary, report=report, recording=recording, quiet=quiet)
        if not quiet:
            result = print_summary(result)
        result.raise_failures()
    except KeyboardInterrupt as interrupt:
        raise typer.Exit(128 + interrupt.args[0]) from None


@app.command()
def generate(
    family: Annotated[
        str, typer.Argument(help="intersection, roundabout, shared-space, random, town, motorway or signals.")
    ],
    out: Annotated[Path, typer.Option(help="Folder to write.")],
    seed: Annotated[int, typer.Option(help="The same seed gives the same files.")] = 1,
    size: Annotated[int | None, typer.Option(help="Streets of a random network.")] = None,
    verbose: Verbose = False,
) -> None:
    """Generate a network with demand: a folder that plain SUMO can run."""
    from slrl_sumo.netgen.errors import NetgenError
    from slrl_sumo.netgen.families import generate as make

    claim(Output("out", out, ("*.xml", "*.sumocfg", "README.md")))
    try:
        typer.echo(make(family, seed, out, size))
    except NetgenError as error:
        raise InputError(str(error)) from None


@app.command()
def record(
    scenario: ScenarioName,
    out: Annotated[
        Path, typer.Option(help="Trajectories file to write, .npz; with --seeds a folder with a file for each.")
    ],
    seconds: Annotated[float, typer.Option(help="Simulated time to record.")] = 600.0,
    seed: Annotated[int, typer.Option(help="SUMO's seed.")] = 1,
    step_length: Annotated[float | None, typer.Option(help="SUMO's step, s; must divide 0.4.")] = None,
    seeds: Annotated[int | None, typer.Option(help="Number of seeds, from --seed on.")] = None,
    workers: Workers = None,
    ray: RayAddress = None,
    verbose: Verbose = False,
) -> None:
    """Record plain SUMO traffic as trajectories: training data for `fit`."""
    from slrl_sumo.jobs.progress import progress
    from slrl_sumo.simulation.record import record_isolated

    claim(Output("out", out, () if seeds is None else ("seed-*.npz", "recordings.json")), scenarios=[scenario])
    if not 0 < seconds < 1e9:
        raise InputError(f"--seconds {seconds:g}: give a number above 0")
    if not 0 <= seed < 2**31:
        raise InputError(f"--seed {seed}: give a whole number from 0 to 2147483647")
    if seeds is not None:
        backend = backend_of(workers, ray)
        from slrl_sumo.studies.recordings import Recordings, write_recordings

        wanted = Recordings(scenario, range(seed, seed + seeds), seconds, step_length)
        interrupted_by = write_recordings(wanted, out, backend)
        if interrupted_by:
            raise typer.Exit(128 + interrupted_by)
        return
    if workers is not None or ray is not None:
        raise InputError(f"--{'ray' if ray else 'workers'}: one recording is one simulation; give --seeds, too")
    if out.suffix != ".npz":
        raise InputError(f"--out {out}: trajectories are files whose name ends in .npz; give it such a name")
    playing = record_isolated(scenario, seconds=seconds, seed=seed, step_length=step_length)
    with closing(playing), progress() as bar:
        task = bar.add_task("recording", total=1.0)
        for item in playing:
            if isinstance(item, float):
                bar.update(task, completed=item)
            else:
                trajectories = item
    if not len(trajectories):
        raise InputError(
            f"{scenario}: no road user was there in the first {seconds:g} s, so nothing is written; give more --seconds"
        )
    trajectories.save(out)
    typer.echo(f"{out}: {len(trajectories.ids)} tracks, {len(trajectories)} positions")


@app.command()
def doctor(
    scenario: ScenarioName,
    json_file: Annotated[Path | None, typer.Option("--json", help="The findings as JSON.")] = None,
    verbose: Verbose = False,
) -> None:
    """List what in a scenario will cause trouble for learned road users, and how to correct it."""
    from slrl_sumo.doctor.isolated import examine_isolated
    from slrl_sumo.doctor.report import findings_record, print_findings
    from slrl_sumo.sumo.scenario import find_scenario

    if json_file is not None:
        claim(Output("json", json_file), scenarios=[scenario])
    found = find_scenario(scenario)
    findings = examine_isolated(found)
    if json_file is not None:
        write_json(json_file, findings_record(found.name, findings))
    print_findings(findings)
    problems = [finding for finding in findings if finding.severity == "problem"]
    if problems:
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise InputError(f"{found.config}: cannot be run: {problems[0].what}{more}; {problems[0].fix}")
