"""The command line: parses, calls, prints. Heavy modules are imported inside the commands, so that --help is quick."""

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from slrl_sumo import __version__
from slrl_sumo.errors import InputError, SlrlError, SumoError

app = typer.Typer(
    help="Learned cars, cyclists and pedestrians inside SUMO scenarios.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _root(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True)] = False) -> None:
    pass


@app.command()
def scenarios() -> None:
    """List the scenarios that ship with the package."""
    from slrl_sumo.sumo.scenario import shipped_scenarios

    for name in shipped_scenarios():
        typer.echo(name)


@app.command()
def run(
    scenario: Annotated[str, typer.Argument(help="Shipped name, folder or .sumocfg.")],
    agents: Annotated[int | None, typer.Option(help="Learned road users to spawn.")] = None,
    mix: Annotated[str | None, typer.Option(help="Shares, e.g. car=0.5,bicycle=0.2,pedestrian=0.3.")] = None,
    takeover: Annotated[str | None, typer.Option(help="Shares of the scenario's own: car=0.3,pedestrian=1.")] = None,
    region: Annotated[
        str | None,
        typer.Option(help="Where: junction:ID,radius=80 | edges:a,b | box:x0,y0,x1,y1; default: everywhere."),
    ] = None,
    bundle: Annotated[str, typer.Option(help="Shipped bundle or folder of one.")] = "intersection",
    selector: Annotated[
        str | None,
        typer.Option(
            help="Who picks the modes: prior, greedy or sampled; or lane: no models. "
            "Default: greedy where the bundle has a trained selector, else prior."
        ),
    ] = None,
    guard: Annotated[
        bool, typer.Option("--guard", help="Never choose modes that lead into a conflict, where others are left.")
    ] = False,
    steps: Annotated[int | None, typer.Option(help="Decisions of 0.4 s; default: to the scenario's end.")] = None,
    until: Annotated[float | None, typer.Option(help="Simulation time to stop at, s.")] = None,
    seed: Annotated[int, typer.Option(help="Of SUMO, the places and the choices.")] = 1,
    step_length: Annotated[float | None, typer.Option(help="SUMO's step, s; must divide 0.4.")] = None,
    fcd: Annotated[Path | None, typer.Option(help="Trace: .xml, .xml.gz or .csv.")] = None,
    summary: Annotated[Path | None, typer.Option(help="Summary as JSON.")] = None,
    report: Annotated[Path | None, typer.Option(help="Folder for pictures.")] = None,
    no_yield: Annotated[bool, typer.Option("--no-yield", help="Background vehicles do not brake for them.")] = False,
    sumo_outputs: Annotated[bool, typer.Option(help="Let the scenario write its own output files.")] = False,
    sumo_options: Annotated[str, typer.Option(help='Options for SUMO, e.g. "--lateral-resolution 0.8".')] = "",
    quiet: Annotated[bool, typer.Option(help="Print nothing but errors.")] = False,
) -> None:
    """Run learned road users in a scenario and write what happened."""
    if steps is not None and until is not None:
        raise InputError("--steps and --until were both given; give one of them")
    from slrl_sumo.simulation.events import RunSettings

    settings = RunSettings(
        scenario=scenario,
        agents=agents,
        bundle=bundle,
        selector=selector,
        mix=mix,
        takeover=takeover,
        region=region,
        guard=guard,
        steps=steps,
        until=until,
        seed=seed,
        step_length=step_length,
        yielding=not no_yield,
        sumo_outputs=sumo_outputs,
        sumo_options=sumo_options,
    )
    from slrl_sumo.analysis.outputs import write_run

    interrupted_by = write_run(settings, fcd=fcd, summary=summary, report=report, quiet=quiet)
    if interrupted_by:
        raise typer.Exit(128 + interrupted_by)


@app.command()
def generate(
    family: Annotated[str, typer.Argument(help="intersection, roundabout, shared-space or random.")],
    out: Annotated[Path, typer.Option(help="Folder to write.")],
    seed: Annotated[int, typer.Option(help="The same seed gives the same files.")] = 1,
    size: Annotated[int | None, typer.Option(help="Streets of a random network.")] = None,
) -> None:
    """Make a network with demand: a folder that plain SUMO runs."""
    from netgen.errors import NetgenError
    from netgen.families import generate as make

    try:
        typer.echo(make(family, seed, out, size))
    except NetgenError as error:
        raise InputError(str(error)) from None


@app.command()
def record(
    scenario: Annotated[str, typer.Argument(help="Shipped name, folder or .sumocfg.")],
    out: Annotated[Path, typer.Option(help="Trajectories file to write, .npz.")],
    seconds: Annotated[float, typer.Option(help="Simulated time to record.")] = 600.0,
    seed: Annotated[int, typer.Option(help="SUMO's seed.")] = 1,
    step_length: Annotated[float | None, typer.Option(help="SUMO's step, s; must divide 0.4.")] = None,
) -> None:
    """Record plain SUMO traffic as trajectories: teacher data for `fit`."""
    from slrl_sumo.analysis.progress import progress
    from slrl_sumo.simulation.record import record as play
    from slrl_sumo.sumo.scenario import find_scenario

    _check_output(out)
    if not 0 < seconds < 1e9:
        raise InputError(f"--seconds {seconds:g}: give a number above 0")
    if not 0 <= seed < 2**31:
        raise InputError(f"--seed {seed}: give a whole number from 0 to 2147483647")
    with progress() as bar:
        task = bar.add_task("recording", total=1.0)
        for item in play(find_scenario(scenario), seconds=seconds, seed=seed, step_length=step_length):
            if isinstance(item, float):
                bar.update(task, completed=item)
            else:
                trajectories = item
    trajectories.save(out)
    typer.echo(f"{out}: {len(trajectories.ids)} tracks, {len(trajectories)} positions")


@app.command("import")
def import_(
    format: Annotated[
        str,
        typer.Argument(
            metavar="FORMAT",
            help="levelx (or inD, rounD, uniD, exiD), sind, interaction, taf-bw, sdd, dut, citr, hc or fcd.",
        ),
    ],
    path: Annotated[Path, typer.Argument(help="A file of one recording, or a folder with any number of them.")],
    out: Annotated[
        Path,
        typer.Option(
            help="FILE.npz: all recordings in one file, one after another in time, so that they never meet. "
            "Any other name is a folder: one file per recording."
        ),
    ],
) -> None:
    """Turn recordings of road users into trajectories of 0.4 s."""
    from slrl_sumo.analysis.progress import progress
    from slrl_sumo.records.importers.formats import find_recordings, join

    _check_output(out)
    single = out.suffix == ".npz"
    if out.exists() and out.is_dir() == single:
        raise InputError(f"{out}: is there and is {'a folder' if single else 'no folder'}; give another --out")
    found = find_recordings(format, path)
    parts = []
    with progress("{task.fields[name]}") as bar:
        task = bar.add_task("importing", total=len(found), name="")
        for recording in found:
            bar.update(task, name=recording.name)
            trajectories = recording.read()
            if single:
                parts.append((recording.name, trajectories))
            else:
                out.mkdir(exist_ok=True)
                file = out / f"{recording.name}.npz"
                trajectories.save(file)
                typer.echo(f"{file}: {len(trajectories.ids)} tracks, {len(trajectories)} positions")
            bar.advance(task)
    if single:
        trajectories = join(parts)
        trajectories.save(out)
        count = f"{len(found)} recording{'s' * (len(found) > 1)}"
        typer.echo(f"{out}: {count}, {len(trajectories.ids)} tracks, {len(trajectories)} positions")


@app.command()
def fit(
    files: Annotated[list[Path], typer.Argument(help="Trajectories files.")],
    out: Annotated[Path, typer.Option(help="Bundle folder to write.")],
    seed: Annotated[int, typer.Option(help="The same seed gives the same bundle.")] = 1,
    epochs: Annotated[int, typer.Option(help="Passes over the windows.")] = 35,
    modes: Annotated[
        str,
        typer.Option(help="Clusters of: relative (to the own speed), kmeans (the paper's), balanced (more turning)."),
    ] = "relative",
    test: Annotated[
        list[Path] | None,
        typer.Option(help="Trajectories to measure errors on, not learned from; default: a tenth of the tracks."),
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Folder for pictures of the modes.")] = None,
) -> None:
    """Learn modes, displacement models and prior from trajectories."""
    from slrl_sumo.learning.fit import fit as learn
    from slrl_sumo.records.trajectories import load_trajectories

    if report is not None:
        _check_output(report)
    recordings, tests = ([load_trajectories(file) for file in some] for some in (files, test or []))
    bundle = learn(recordings, name=out.name, seed=seed, epochs=epochs, modes=modes, tests=tests)
    bundle.save(out)
    if report is not None:
        from slrl_sumo.analysis.modes_report import write_modes

        write_modes(recordings, report, seed)
    typer.echo(f"{out}: bundle '{bundle.name}'; see {out / 'MODEL_CARD.md'}")


@app.command()
def train(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO|FAMILY",
            help="intersection, roundabout, shared-space or random, drawn anew; or a scenario; several with commas.",
        ),
    ],
    bundle: Annotated[str, typer.Option(help="Shipped bundle or folder of one: its models stay as they are.")],
    out: Annotated[Path, typer.Option(help="Bundle folder to write; OUT-training holds checkpoints and logs.")],
    steps: Annotated[int, typer.Option(help="Decisions of single road users, in all.")] = 5_000_000,
    workers: Annotated[int, typer.Option(help="Simulations side by side, a process each.")] = 2,
    seed: Annotated[int, typer.Option(help="The same seed gives the same selector.")] = 1,
    config: Annotated[Path | None, typer.Option(help="Settings that differ from the usual ones, .toml.")] = None,
    device: Annotated[str, typer.Option(help="Where the policy learns: auto, cpu or cuda.")] = "auto",
    threads: Annotated[int, typer.Option(help="Threads of the policy's update.")] = 1,
    recording: Annotated[
        list[Path] | None,
        typer.Option(help="Trajectories to imitate first, besides SUMO's own traffic in the networks."),
    ] = None,
    episodes: Annotated[int, typer.Option(help="Of the closing evaluation, per selector; 0: none.")] = 8,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the last checkpoint.")] = False,
) -> None:
    """Train the selector of a bundle by reinforcement learning."""
    from slrl_sumo.analysis.training import train_with_progress
    from slrl_sumo.learning.train import TrainRequest
    from slrl_sumo.learning.train_settings import read_settings

    _check_output(out)
    for name, value, most in (("steps", steps, 10**12), ("workers", workers, 1024), ("threads", threads, 1024)):
        if not 1 <= value <= most:
            raise InputError(f"--{name} {value}: give a whole number from 1 to {most}")
    if not 0 <= seed < 2**31:
        raise InputError(f"--seed {seed}: give a whole number from 0 to 2147483647")
    if episodes < 0:
        raise InputError(f"--episodes {episodes}: give a whole number from 0")
    request = TrainRequest(scenario, bundle, out, steps, workers, seed, device, threads, tuple(recording or ()))
    if not train_with_progress(request, read_settings(config), resume=resume):
        raise typer.Exit(130)
    typer.echo(f"{out}: bundle with a trained selector; charts: tensorboard --logdir {request.folder / 'tensorboard'}")
    if episodes:
        from slrl_sumo.analysis.scenario_evaluation import EvaluationSettings, write_evaluation
        from slrl_sumo.analysis.training import closing_scenario

        where = closing_scenario(scenario)
        closing = EvaluationSettings(where, str(out), episodes=episodes, seed=seed, workers=workers)
        interrupted_by = write_evaluation(closing, request.folder / "evaluation")
        if interrupted_by:
            raise typer.Exit(128 + interrupted_by)


@app.command()
def evaluate(
    what: Annotated[
        str, typer.Argument(metavar="SCENARIO|FILE", help="Scenario as in `run`, or trajectories of a recording, .npz.")
    ],
    bundle: Annotated[str, typer.Option(help="Shipped bundle or folder of one.")],
    out: Annotated[Path, typer.Option(help="Folder to write: results.json, results.csv and more.")],
    selectors: Annotated[
        str | None, typer.Option(help="Separated by commas; default: all that there are for bundle and input.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of everything that is drawn.")] = 1,
    agents: Annotated[
        str | None, typer.Option(help="SCENARIO: learned road users, e.g. 16,32,64. [default: 32]")
    ] = None,
    episodes: Annotated[int | None, typer.Option(help="SCENARIO: per selector, agents and seed. [default: 64]")] = None,
    steps: Annotated[int | None, typer.Option(help="SCENARIO: decisions of 0.4 s. [default: 128]")] = None,
    seeds: Annotated[int | None, typer.Option(help="SCENARIO: seeds, from --seed on. [default: 1]")] = None,
    workers: Annotated[int | None, typer.Option(help="SCENARIO: processes. [default: 2]")] = None,
    recording: Annotated[Path | None, typer.Option(help="SCENARIO: trajectories to count beside.")] = None,
    starts: Annotated[
        int | None, typer.Option(help="FILE: a rollout begins at every so manieth frame of 0.4 s. [default: 5]")
    ] = None,
    net: Annotated[
        Path | None, typer.Option(help="FILE: SUMO network in its coordinates; without: everything is road.")
    ] = None,
    mask: Annotated[
        Path | None,
        typer.Option(help="FILE: or a PNG: white road, yellow sidewalk, black nothing; upper left at 0, 0."),
    ] = None,
    metres_per_pixel: Annotated[float | None, typer.Option(help="FILE: of --mask.")] = None,
) -> None:
    """Measure selectors in a scenario, or prediction errors over 6.4 s on a recording."""
    from slrl_sumo.analysis.prediction_report import check_folder

    is_file = what.endswith(".npz")
    names = None if selectors is None else tuple(name.strip() for name in selectors.split(","))
    scenario_options = {
        "episodes": episodes,
        "steps": steps,
        "seeds": seeds,
        "workers": workers,
        "recording": recording,
    }
    file_options = {"starts": starts, "net": net, "mask": mask, "metres-per-pixel": metres_per_pixel}
    for option, value in ({"agents": agents, **scenario_options} if is_file else file_options).items():
        if value is not None:
            kind, other = ("a recording", "a scenario") if is_file else ("a scenario", "a recording (.npz)")
            raise InputError(f"--{option} {value}: belongs to {other}, and {what} is {kind}; leave it out")
    check_folder(out)
    if is_file:
        ground = (net, mask, metres_per_pixel)
        _evaluate_recording(what, bundle, out, names, 5 if starts is None else starts, seed, ground)
        return
    given: dict[str, Any] = {name: value for name, value in scenario_options.items() if value is not None}
    if agents is not None:
        try:
            given["agents"] = tuple(dict.fromkeys(int(number) for number in agents.split(",")))
        except ValueError:
            raise InputError(f"--agents {agents}: give whole numbers separated by commas, e.g. 16,32,64") from None
    from slrl_sumo.analysis.scenario_evaluation import EvaluationSettings, write_evaluation

    settings = EvaluationSettings(scenario=what, bundle=bundle, selectors=names or (), seed=seed, **given)
    interrupted_by = write_evaluation(settings, out)
    if interrupted_by:
        raise typer.Exit(128 + interrupted_by)


def _evaluate_recording(
    file: str,
    bundle: str,
    out: Path,
    selectors: tuple[str, ...] | None,
    starts: int,
    seed: int,
    ground: tuple[Path | None, Path | None, float | None],
) -> None:
    from slrl_sumo.analysis.evaluate import evaluate as measure
    from slrl_sumo.analysis.ground import given_ground
    from slrl_sumo.analysis.prediction_report import print_evaluation, write_evaluation
    from slrl_sumo.analysis.progress import progress
    from slrl_sumo.models.bundle import load_bundle
    from slrl_sumo.records.trajectories import load_trajectories

    recording, models = load_trajectories(file), load_bundle(bundle)
    roadmap, surface = given_ground(recording, *ground)
    with progress() as bar:
        task = bar.add_task("rollouts", total=1.0)
        result = measure(
            recording,
            models,
            selectors=selectors,
            roadmap=roadmap,
            surface=surface,
            starts_every=starts,
            seed=seed,
            progress=lambda share: bar.update(task, completed=share),
        )
    write_evaluation(result, out)
    print_evaluation(result)


@app.command()
def doctor(
    scenario: Annotated[str, typer.Argument(help="Shipped name, folder or .sumocfg.")],
    json_file: Annotated[Path | None, typer.Option("--json", help="The findings as JSON.")] = None,
) -> None:
    """Say what in a scenario will hurt learned road users, and what to do about it."""
    import json

    from slrl_sumo.analysis.findings import findings_record, print_findings
    from slrl_sumo.simulation.doctor import examine
    from slrl_sumo.sumo.scenario import find_scenario

    if json_file is not None:
        _check_output(json_file)
    found = find_scenario(scenario)
    findings = examine(found)
    if json_file is not None:
        text = json.dumps(findings_record(found.name, findings), indent=2) + "\n"
        try:
            json_file.write_text(text, encoding="utf-8")
        except OSError as error:
            raise InputError(f"{json_file}: cannot be written ({error.strerror}); name another file") from None
    print_findings(findings)
    problems = [finding for finding in findings if finding.severity == "problem"]
    if problems:
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise InputError(f"{found.config}: cannot be run: {problems[0].what}{more}; {problems[0].fix}")


def _check_output(file: Path) -> None:
    if not file.resolve().parent.is_dir():
        raise InputError(f"{file}: the folder {file.resolve().parent} does not exist; create it or name another")


def main() -> None:
    """Entry point. Exit codes: 0 done, 1 wrong input (one line on stderr), 2 usage, 3 SUMO died."""
    try:
        app()
    except InputError as error:
        _fail(1, error)
    except SumoError as error:
        _fail(3, SumoError(f"{error}; outputs are complete up to there; repeat it with: {shlex.join(_command())}"))


def _command() -> list[str]:
    return ["slrl-sumo", *sys.argv[1:]]


def _fail(code: int, error: SlrlError) -> None:
    print(f"slrl-sumo: {error}", file=sys.stderr)
    sys.exit(code)


if __name__ == "__main__":
    main()
