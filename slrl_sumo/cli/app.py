"""The application that every command belongs to, and options that several commands share."""

from typing import Annotated

import typer

from slrl_sumo.jobs.pool import Backend
from slrl_sumo.jobs.ray_cluster import check_ray
from slrl_sumo.version import __version__

app = typer.Typer(
    help="Learned cars, cyclists and pedestrians inside SUMO scenarios.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


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


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _root(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True)] = False) -> None:
    pass
