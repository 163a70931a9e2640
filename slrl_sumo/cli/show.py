"""Commands that show results: replay."""

from pathlib import Path
from typing import Annotated

import typer

from slrl_sumo.cli.app import Verbose, app, claim
from slrl_sumo.errors import InputError
from slrl_sumo.formats.output_files import Output


@app.command()
def replay(
    fcd: Annotated[Path, typer.Argument(help="Trace (FCD), ours or SUMO's: .xml, .xml.gz, .csv or .parquet.")],
    net: Annotated[
        str,
        typer.Option(
            help="Its network: .net.xml(.gz), .sumocfg or shipped name. A scenario also gives the sizes of vehicles."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Page to write, .html.")],
    signals: Annotated[
        Path | None,
        typer.Option(
            help="What traffic lights show: SUMO's output of SaveTLSStates. "
            "[default: of the file that `run` wrote beside the trace]"
        ),
    ] = None,
    verbose: Verbose = False,
) -> None:
    """Write a page that plays a trace over its network, in any browser and without a connection."""
    from slrl_sumo.replay.page import write_replay

    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out}: browsers want a name that ends in .html")
    claim(Output("out", out), inputs=[fcd, net, *([] if signals is None else [signals])])
    write_replay(fcd, net, out, signals)
    size = out.stat().st_size
    typer.echo(f"{out}: {f'{size / 1e6:.1f} MB' if size >= 1e6 else f'{size / 1e3:.0f} kB'}; open it in a browser")
