"""Commands that learn: import, fit, train."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from slrl_sumo.cli.app import RayAddress, Verbose, app, backend_of, claim
from slrl_sumo.errors import InputError, check_whole_number
from slrl_sumo.extras import require
from slrl_sumo.formats.output_files import REPLACED, Output
from slrl_sumo.models.bundle_folder import DEFAULT_BUNDLE

if TYPE_CHECKING:
    from slrl_sumo.formats.trajectories import Trajectories

NAMED_RECORDINGS = 20
"""Recordings, and notes on them, that `import` names; of more it tells the number."""


@app.command("import")
def import_(
    format: Annotated[
        str,
        typer.Argument(
            metavar="FORMAT",
            help="levelx (or inD, rounD, uniD, exiD), sind, interaction, taf-bw, sdd, dut, citr, ngsim, tgsim, hc or "
            "fcd.",
        ),
    ],
    path: Annotated[Path, typer.Argument(help="A file of one recording, or a folder with any number of them.")],
    out: Annotated[
        Path,
        typer.Option(
            help="FILE.npz: all recordings in one file, one after another in time, so that they do not mix. "
            "Any other name is a folder: one file per recording."
        ),
    ],
    verbose: Verbose = False,
) -> None:
    """Convert recordings of road users into trajectories with a step of 0.4 s.

    What was corrected is noted on stderr: rows that are twice, headings against the motion, unknown classes. Of several
    recordings those that cannot be read are named and left out; the command fails where none is left.
    """
    from slrl_sumo.formats.importers.formats import find_recordings, join
    from slrl_sumo.jobs.progress import progress

    single = out.suffix == ".npz"
    claim(Output("out", out, () if single else ("*.npz",)), inputs=[path] if path.is_file() else [])
    found = find_recordings(format, path)
    parts: list[tuple[str, Trajectories]] = []
    lines: list[str] = []
    notes: list[str] = []
    bad: list[InputError] = []
    with progress("{task.fields[name]}") as bar:
        task = bar.add_task("importing", total=len(found), name="")
        for recording in found:
            bar.update(task, name=recording.name)
            try:
                trajectories = recording.read()
            except InputError as error:
                if len(found) == 1:
                    raise
                bad.append(error)
            else:
                notes += [f"{recording.name}: {note}" for note in trajectories.notes]
                if single:
                    parts.append((recording.name, trajectories))
                else:
                    out.mkdir(exist_ok=True)
                    file = out / f"{recording.name}.npz"
                    trajectories.save(file)
                    lines.append(f"{file}: {len(trajectories.ids)} tracks, {len(trajectories)} positions")
            bar.advance(task)
    for text in _at_most(notes, "notes"):
        typer.echo(f"note: {text}", err=True)
    for text in _at_most([str(error) for error in bad], "recordings"):
        typer.echo(f"left out: {text}", err=True)
    if len(bad) == len(found):
        raise InputError(f"{path}: none of the {len(found)} recordings can be read; the reasons are above")
    count = f"{len(found) - len(bad)} recording{'s' * (len(found) - len(bad) > 1)}"
    left_out = f"; {len(bad)} of {len(found)} left out, see above" if bad else ""
    if single:
        trajectories = join(parts)
        trajectories.save(out)
        lines.append(f"{out}: {count}, {len(trajectories.ids)} tracks, {len(trajectories)} positions{left_out}")
    elif bad:
        lines.append(f"{out}: {count}{left_out}")
    typer.echo("\n".join(lines))


def _at_most(texts: list[str], what: str) -> list[str]:
    """The texts, or the first NAMED_RECORDINGS of them and how many there are more."""
    return (
        texts
        if len(texts) <= NAMED_RECORDINGS
        else [*texts[:NAMED_RECORDINGS], f"… and {len(texts) - NAMED_RECORDINGS} {what} more"]
    )


@app.command()
def fit(
    files: Annotated[list[Path], typer.Argument(metavar="FILE", help="Trajectories files.")],
    out: Annotated[Path, typer.Option(help="Bundle folder to write.")],
    seed: Annotated[int, typer.Option(help="The same seed gives the same bundle.")] = 1,
    epochs: Annotated[int, typer.Option(help="Passes over the windows.")] = 35,
    modes: Annotated[
        str,
        typer.Option(
            help="Modes: paths (each model learns the paths that it predicts best), or what they are clusters of: "
            "relative (destinations relative to the own speed), kmeans (destinations, the paper's), balanced (these, "
            "more turning), curved (vehicles: distance and curvature) or accelerations (vehicles: relative to those at "
            "that speed)."
        ),
    ] = "paths",
    preset: Annotated[
        str,
        typer.Option(help="What models read: history (the last 2 s, nearest road users) or paper (its 12 numbers)."),
    ] = "history",
    test: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Trajectories to measure errors on, not used in training. [default: a tenth of the tracks]",
        ),
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Folder for figures of the modes.")] = None,
    verbose: Verbose = False,
) -> None:
    """Learn modes, displacement models and prior from trajectories."""
    require("sklearn", "fit")
    if report is not None:
        require("matplotlib", f"--report {report}")
    from slrl_sumo.formats.trajectory_file import load_trajectories
    from slrl_sumo.learning.supervised.fit import TooFewTracksError
    from slrl_sumo.learning.supervised.fit import fit as learn
    from slrl_sumo.models.bundle_folder import check_replaceable
    from slrl_sumo.studies.prediction.modes_report import MODES_FILES, write_modes

    pictures = [Output("report", report, MODES_FILES)] if report is not None else []
    claim(Output("out", out, REPLACED), *pictures, inputs=[*files, *(test or [])])
    check_replaceable(out)
    for file in test or []:
        if file.resolve() in {other.resolve() for other in files}:
            raise InputError("is learned from as well; errors are measured on other files", argument="test", value=file)
    recordings, tests = ([load_trajectories(file) for file in some] for some in (files, test or []))
    try:
        bundle = learn(recordings, name=out.name, seed=seed, epochs=epochs, modes=modes, preset=preset, tests=tests)
    except TooFewTracksError as error:
        raise InputError(f"{', '.join(_at_most([str(file) for file in files], 'files'))}: {error}") from None
    bundle.save(out)
    for kind, reason in bundle.training["left_out"].items():
        typer.echo(f"note: no models for {kind}: {reason}", err=True)
    if report is not None:
        write_modes(recordings, report, seed, bundle.training["types"])
    typer.echo(f"{out}: bundle '{bundle.name}'; see {out / 'MODEL_CARD.md'}")


@app.command()
def train(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO|FAMILY",
            help="intersection, roundabout, shared-space, random, town, motorway or signals, generated; or a scenario; "
            "several with commas.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Bundle folder to write; OUT-training holds checkpoints and logs.")],
    bundle: Annotated[
        str | None,
        typer.Option(
            help="Shipped bundle or folder of one; its displacement models stay as they are. [default: intersection]"
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="BUNDLE",
            help="As --bundle, and go on from its selector with the settings of its training.",
        ),
    ] = None,
    steps: Annotated[int, typer.Option(help="Decisions of single road users in total.")] = 5_000_000,
    workers: Annotated[int, typer.Option(help="Simulations side by side, a process each.")] = 2,
    ray: RayAddress = None,
    seed: Annotated[int, typer.Option(help="The same seed gives the same selector.")] = 1,
    config: Annotated[
        Path | None, typer.Option(help="Settings that differ from the defaults, or from those of --from, .toml.")
    ] = None,
    device: Annotated[str, typer.Option(help="Device of the policy update: auto, cpu or cuda.")] = "auto",
    threads: Annotated[
        int | None,
        typer.Option(help="Threads of the policy update. [default: as many as workers, which are idle meanwhile]"),
    ] = None,
    recording: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE", help="Trajectories for the imitation phase, besides SUMO's own traffic in the networks."
        ),
    ] = None,
    episodes: Annotated[int, typer.Option(help="Episodes of the final evaluation, per selector; 0: none.")] = 8,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from the last checkpoint.")] = False,
    verbose: Verbose = False,
) -> None:
    """Train the selector of a bundle by reinforcement learning."""
    require("tensorboard", "train")
    backend = backend_of(workers, ray)
    from slrl_sumo.cli.train_display import train_with_progress
    from slrl_sumo.learning.rl.train import TrainRequest
    from slrl_sumo.learning.rl.training_settings import read_settings, recorded_settings
    from slrl_sumo.models.bundle import load_bundle
    from slrl_sumo.models.bundle_folder import check_replaceable
    from slrl_sumo.netgen.families import Family

    check_whole_number("episodes", episodes, 0, 1_000_000)
    if bundle is not None and start is not None:
        raise InputError("give either --bundle, whose selector is trained anew, or --from, whose selector goes on")
    source = bundle or start or DEFAULT_BUNDLE
    request = TrainRequest(
        scenario, source, out, steps, workers, seed, device, threads, tuple(recording or ()), ray, start is not None
    )
    claim(
        Output("out", out, REPLACED),
        Output("out", request.folder, REPLACED),
        inputs=[source, config, *(recording or [])],
        scenarios=[name for name in scenario.split(",") if name.strip() not in get_args(Family)],
    )
    check_replaceable(out)
    settings = read_settings(config, None if start is None else recorded_settings(load_bundle(start)))
    if interrupted_by := train_with_progress(request, settings, resume=resume):
        raise typer.Exit(128 + interrupted_by)
    typer.echo(f"{out}: bundle with a trained selector; charts: tensorboard --logdir {request.folder / 'tensorboard'}")
    if episodes:
        from slrl_sumo.cli.train_display import closing_scenario
        from slrl_sumo.studies.episodes.evaluate import EvaluationSettings, write_evaluation

        where = closing_scenario(scenario)
        closing = EvaluationSettings(where, str(out), episodes=episodes, seed=seed, backend=backend)
        interrupted_by = write_evaluation(closing, request.folder / "evaluation")
        if interrupted_by:
            raise typer.Exit(128 + interrupted_by)
