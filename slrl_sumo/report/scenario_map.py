"""A map of a scenario's network."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from slrl_sumo.errors import InputError
from slrl_sumo.formats.output_files import writing
from slrl_sumo.ground.picture import SURFACE_GREYS, draw_ground
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.sumo.net_file import read_net_file
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.options import input_files

INCHES = 8.0
"""Of the longer side of the map."""


def write_scenario_map(scenario: Scenario, file: Path) -> None:
    """Write the map of the scenario's network as .png, .svg or .pdf. Raises InputError where it names no network."""
    nets = input_files(scenario, "net-file")
    if len(nets) != 1:
        raise InputError(f"{scenario.config}: it names no network; give a scenario with a net-file")
    network = read_net_file(nets[0])
    if not network.surfaces().shapes:
        raise InputError(f"{nets[0]}: there are no lanes of road users in it")
    with writing(file):
        draw_network(network, scenario.name).savefig(file, dpi=150)


def draw_network(network: Network, title: str) -> Figure:
    """Surfaces, and the junctions with signals by their ids, in metres."""
    ground = draw_ground(network.surfaces())
    left, right, bottom, top = ground.extent
    figure = Figure(figsize=ground.fitting(INCHES, (4.0, 3.0)), layout="constrained")
    axes = figure.subplots()
    axes.imshow(ground.pixels, origin="lower", extent=ground.extent, interpolation="nearest")
    present = {shape.surface for shape in network.surfaces().shapes}
    handles: list[Patch | Line2D] = [
        Patch(facecolor=f"#{bytes(SURFACE_GREYS[surface]).hex()}", edgecolor="#888888", label=surface.name.lower())
        for surface in Surface
        if surface in present
    ]
    signals = {name: ids for name, ids in network.signal_junctions.items() if ids}
    for name, ids in signals.items():
        x, y = np.mean([network.junction_positions[junction] for junction in ids], axis=0)
        axes.plot(x, y, "s", color="#D55E00", ms=5)
        axes.annotate(name, (x, y), textcoords="offset points", xytext=(5, 5), fontsize=7)
    if signals:
        handles.append(Line2D([], [], ls="", marker="s", color="#D55E00", label="signals"))
    figure.legend(handles=handles, fontsize=8, loc="outside right upper")
    axes.set_title(f"{title}: {right - left - 10:.0f} m x {top - bottom - 10:.0f} m")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    return figure
