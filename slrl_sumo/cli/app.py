"""The application that every command belongs to, and options that several commands share."""

import logging
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from slrl_sumo.errors import InputError
from slrl_sumo.formats.output_files import Output, claimed
from slrl_sumo.jobs.pool import Backend
from slrl_sumo.jobs.ray_cluster import check_ray
from slrl_sumo.version import __version__

app = typer.Typer(
    help="Learned cars, cyclists and pedestrians inside SUMO scenarios.",
    no_args_is_help=True,
    # Plain help: as boxes it would drop the defaults in brackets, and print values of flags that take none.
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

claims = ExitStack()
"""What the command has claimed: `main` gives it back at its end."""


def _log_to_stderr(wanted: bool) -> None:
    if wanted:
        log, handler = logging.getLogger("slrl_sumo"), logging.StreamHandler()
        handler.setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s", "%H:%M:%S"))
        log.addHandler(handler)
        log.setLevel(logging.INFO)
        claims.callback(log.removeHandler, handler)


def _names_of(find: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """A completion with names; where none fits, shells complete files."""
    return lambda incomplete: [name for name in find() if name.startswith(incomplete)]


def _shipped_scenarios() -> list[str]:
    from slrl_sumo.sumo.scenario import shipped_scenarios

    return shipped_scenarios()


def _shipped_bundles() -> list[str]:
    from slrl_sumo.models.bundle_folder import shipped_bundles

    return shipped_bundles()


scenario_names, bundle_names = _names_of(_shipped_scenarios), _names_of(_shipped_bundles)

Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Log the steps on stderr, with times.", callback=_log_to_stderr)
]
ScenarioName = Annotated[
    str,
    typer.Argument(metavar="SCENARIO", help="Shipped name, folder or .sumocfg.", autocompletion=scenario_names),
]
BundleName = Annotated[str, typer.Option(help="Shipped bundle or folder of one.", autocompletion=bundle_names)]
RegionText = Annotated[
    str | None,
    typer.Option(
        help="Where: junction:ID,radius=80 (ID of a junction or traffic light) | edges:a,b | box:x0,y0,x1,y1. "
        "[default: everywhere]"
    ),
]
ExcludedIds = Annotated[
    list[str] | None,
    typer.Option(
        metavar="IDS",
        help="Road users that are neither taken over nor held for learned ones, as ego,bus_3; may be given several "
        "times.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(help="Simulations at the same time, a process each. [default: 2; with --ray: all cores]"),
]
RayAddress = Annotated[
    str | None,
    typer.Option(
        "--ray",
        metavar="[HOST:PORT|auto|local]",
        help="Run on a Ray cluster: HOST:PORT of its head, or auto for the one of this machine; no value: a local Ray.",
    ),
]


def backend_of(workers: int | None, ray: str | None) -> Backend:
    """Where to run: what is wrong with it is said before anything large is imported."""
    if ray is not None:
        check_ray(ray)
    return Backend(workers, ray)


def claim(*outputs: Output, inputs: Iterable[str | Path | None] = (), scenarios: Iterable[str] = ()) -> None:
    """Claim the outputs of a command until it ends: see `claimed`. `inputs` may be names of shipped data.

    Raises InputError where one of `scenarios` does not exist, too.
    """
    from slrl_sumo.sumo.scenario import find_scenario
    from slrl_sumo.sumo.scenario.options import named_files

    files = [Path(path) for path in inputs if path is not None]
    files += [path for name in scenarios for path in named_files(find_scenario(name.strip()))]
    claims.enter_context(claimed(outputs, files))


def numbers(option: str, text: str) -> tuple[int, ...]:
    """The whole numbers of an option that takes several. Raises InputError."""
    try:
        return tuple(dict.fromkeys(int(number) for number in text.split(",")))
    except ValueError:
        raise InputError(f"--{option} {text}: give whole numbers separated by commas, e.g. 16,32,64") from None


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _root(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True)] = False) -> None:
    pass
