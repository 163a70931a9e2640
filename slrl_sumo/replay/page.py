"""The replay page: a trace over its network as one HTML file that needs nothing else."""

import base64
import hashlib
import html
import json
import sys
import zlib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.table import FcdTable, read_table, user_types
from slrl_sumo.formats.fcd.trace import add_learned, learned_file, signals_file
from slrl_sumo.formats.output_files import write_file
from slrl_sumo.formats.signal_states import Shown, read_signals
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Area, Ribbon, Surface, SurfaceShapes
from slrl_sumo.jobs.progress import progress
from slrl_sumo.metrics.encounters import DEFINITIONS
from slrl_sumo.metrics.near_misses import Conflict, find_conflicts
from slrl_sumo.replay.compact import HEADING_UNITS, METRE, SPEED_UNITS, Rows, pack
from slrl_sumo.replay.signal_bars import signal_bars
from slrl_sumo.replay.vehicle_sizes import CLASS_NAMES, Size, class_of, scenario_classes, scenario_sizes, size_of
from slrl_sumo.scene.geometry import Floats, centre_from_front, heading_from_sumo
from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.sumo.net_file import find_net, read_net_signals
from slrl_sumo.sumo.network import Network

MOST_CONFLICTS = 2000
"""In the page's list: collisions first, then the near misses with the smallest times to collision."""
SAMPLE = 20_000
"""Number of positions that are compared with the network."""
SURFACE_MARGIN = 2.0
"""Distance (m) from a surface within which a position belongs to the network: SUMO's persons walk there at dead
ends."""
FOREIGN, ODD = 0.4, 0.05
"""Shares of positions off the network above which the trace belongs to another network, and above which a note says
so."""
SCRIPTS = ("unpack.js", "ground.js", "signals.js", "colours.js", "scene.js", "exports.js", "controls.js")
"""Of the page, in their order (slrl_sumo/replay/assets)."""


@dataclass(frozen=True)
class Users:
    """All road users of a trace, (u,) each."""

    ids: tuple[str, ...]
    vtypes: tuple[str, ...]
    """SUMO vehicle type id, '' where the trace has none."""
    kind: NDArray[np.int8]
    """RoadUserType."""
    length: Floats
    """m"""
    width: Floats
    classes: tuple[str, ...]
    """Of CLASS_NAMES; '' for passenger cars, bicycles and pedestrians."""


def write_replay(fcd: Path, net: str, out: Path, signals: Path | None = None) -> None:
    """Write the page `out` for the trace `fcd` on the network `net` (file, .sumocfg, folder or shipped scenario).

    `signals`: what traffic lights show, in SUMO's format (SaveTLSStates); None: of the file beside the trace, where
    there is one. A damaged trace is shown up to its first flaw, which is named on stderr, as are files beside it that
    do not fit. Raises InputError where nothing could be read, where most positions lie off the network, and where a
    file cannot be read or written.
    """
    path, scenario = find_net(net)
    sizes, kinds = ({}, {}) if scenario is None else scenario_sizes(scenario)
    vclasses = {} if scenario is None else scenario_classes(scenario)
    with progress() as bar:
        task = bar.add_task("reading", total=1.0)
        table, flaw = read_table(fcd, lambda share: bar.update(task, completed=share))
        network, links = read_net_signals(path)
        notes = [] if flaw is None else [f"{flaw}; the page shows these"]
        notes += note_learned(table, learned_file(fcd), complete=flaw is None)
        shown, unread = find_signals(signals, signals_file(fcd))
        notes += unread
        users = describe(table, sizes, kinds, vclasses)
        rows = centred(table, users)
        notes += check_place(network, rows, fcd, net)
        times = np.array(table.steps, np.int64)
        bar.update(task, description="finding conflicts", total=None)
        conflicts = find_all_conflicts(rows, users, times)
    bars = signal_bars(network, links, shown)
    if signals is not None and not bars:
        raise InputError(f"--signals {signals}: the network {net} has none of its traffic lights; give another one")
    page = build_page(
        network, users, rows, times, conflicts, bars, title=fcd.name, notes=notes, marks_learned=table.marks_learned
    )
    write_file(out, page)
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


def write_trajectories_replay(tracks: Trajectories, net: str, out: Path, *, title: str, signals: Shown) -> None:
    """Write the page `out` for trajectories on the network `net`, as `write_replay` does for a trace."""
    path, _ = find_net(net)
    unknown = ("",) * len(tracks.ids)
    users = Users(tracks.ids, unknown, tracks.type, tracks.length, tracks.width, unknown)
    rows = Rows(
        user=tracks.track,
        step=tracks.frame,
        x=tracks.x,
        y=tracks.y,
        heading=tracks.heading,
        speed=tracks.speed,
        state=np.where(tracks.learned[tracks.track], 2 + tracks.mode.astype(np.int64), 0),
    )
    times = np.rint(1000 * (tracks.t0 + tracks.dt * np.arange(tracks.frames.stop))).astype(np.int64)
    conflicts = find_all_conflicts(rows, users, times)
    network, links = read_net_signals(path)
    bars = signal_bars(network, links, signals)
    page = build_page(network, users, rows, times, conflicts, bars, title=title, notes=[], marks_learned=True)
    write_file(out, page)


def note_learned(table: FcdTable, file: Path | None, *, complete: bool) -> list[str]:
    """Mark the learned road users of the file beside the trace, where there is one; the note where it does not fit."""
    if file is None or not file.exists():
        return []
    try:
        add_learned(table, file, complete=complete)
    except InputError as error:
        return [f"{error}; the page does not show which road users are learned"]
    return []


def find_signals(given: Path | None, beside: Path) -> tuple[Shown, list[str]]:
    """The signal states of the file `given`, else of the one `beside` the trace, and the note where that is unfit."""
    if given is not None:
        return read_signals(given), []
    try:
        return (read_signals(beside) if beside.exists() else {}), []
    except InputError as error:
        return {}, [f"{error}; the page shows no signals"]


def describe(
    table: FcdTable, sizes: dict[str, Size], kinds: dict[str, str], vclasses: dict[str, str] | None = None
) -> Users:
    """The road users of a table with types and boxes; `sizes`, `kinds` and `vclasses` by vehicle type id, see
    `scenario_sizes` and `scenario_classes`."""
    kind = user_types(table, kinds)
    boxes = [size_of(vtype, k, sizes) for (_, vtype), k in zip(table.users, kind.tolist(), strict=True)]
    length, width = np.array(boxes, np.float64).reshape(-1, 2).T
    ids, vtypes = zip(*table.users, strict=True)
    classes = tuple(class_of(vtype, k, vclasses or {}) for vtype, k in zip(vtypes, kind.tolist(), strict=True))
    return Users(ids, vtypes, kind, length, width, classes)


def centred(table: FcdTable, users: Users) -> Rows:
    """The rows of a table, sorted by road user and time, at the centres of boxes."""
    key = np.frombuffer(table.key, np.int32).astype(np.int64)
    order = np.argsort(key, kind="stable")  # times came in order
    key = key[order]
    heading = heading_from_sumo(np.frombuffer(table.angle)[order])
    front_x, front_y = (np.frombuffer(column)[order] for column in (table.x, table.y))
    x, y = centre_from_front(front_x, front_y, heading, users.length[key])
    mode = np.frombuffer(table.mode, np.int8)[order].astype(np.int64)
    learned = np.frombuffer(table.learned, np.int8)[order] > 0
    # Traces without the flag still contain the types of spawned road users.
    learned |= np.array([vtype.startswith("learned_") for vtype in users.vtypes], np.bool_)[key] | (mode > 0)
    return Rows(
        user=key,
        step=np.frombuffer(table.step, np.int32)[order].astype(np.int64),
        x=x,
        y=y,
        heading=heading,
        speed=np.frombuffer(table.speed, np.float32)[order].astype(np.float64),
        state=np.where(learned, 1 + mode, 0),
    )


def check_place(network: Network, rows: Rows, fcd: Path, net: str) -> list[str]:
    """Notes about a trace on this network, one line each; InputError where most of it lies off the network."""
    # Rails and waterways are no surface of a road user type, but trains belong there.
    everything = [
        Ribbon(Surface.ROAD, lane.shape, lane.width) for lane in network.lanes if lane.surface == Surface.NONE
    ]
    shapes = (*(shape for shape, _ in network.painted()), *everything)
    if not shapes:
        raise InputError(f"--net {net}: there are no lanes in it; give the network that {fcd} was made on")
    roadmap = RoadMap(SurfaceShapes(shapes))
    some = np.unique(np.linspace(0, len(rows.x) - 1, SAMPLE).astype(np.int64))
    beside = [
        roadmap.surface_at(rows.x[some] + dx, rows.y[some] + dy) == Surface.NONE
        for dx, dy in (
            (0.0, 0.0),
            (SURFACE_MARGIN, 0.0),
            (-SURFACE_MARGIN, 0.0),
            (0.0, SURFACE_MARGIN),
            (0.0, -SURFACE_MARGIN),
        )
    ]
    off = float(np.all(beside, axis=0).mean())
    x0, y0, x1, y1 = roadmap.bounds
    where = (
        f"{off:.0%} of the positions in {fcd} lie off the network {net}, which reaches from ({x0:.0f}, {y0:.0f}) to "
        f"({x1:.0f}, {y1:.0f}) m; the trace goes from ({rows.x.min():.0f}, {rows.y.min():.0f}) to "
        f"({rows.x.max():.0f}, {rows.y.max():.0f}) m"
    )
    if off > FOREIGN:
        raise InputError(f"{where}; give the network that it was made on")
    return [where] if off > ODD else []


def find_all_conflicts(rows: Rows, users: Users, times: NDArray[np.int64]) -> list[Conflict]:
    """Collisions and near misses; `times`: ms. Unknown speeds are computed from the movement since the step before, 0
    where there is none."""
    seconds = np.diff(times[rows.step], prepend=0) / 1000.0
    follows = (np.diff(rows.user, prepend=-1) == 0) & (np.diff(rows.step, prepend=-1) == 1)
    moved = np.hypot(np.diff(rows.x, prepend=0.0), np.diff(rows.y, prepend=0.0))
    travelled = np.where(follows, moved / np.where(follows, seconds, 1.0), 0.0)
    return find_conflicts(
        box=np.column_stack([rows.x, rows.y, rows.heading, users.length[rows.user], users.width[rows.user]]),
        speed=np.where(np.isfinite(rows.speed), rows.speed, travelled),
        kind=users.kind[rows.user],
        user=rows.user,
        frame=rows.step,
        times=times / 1000.0,
    )


def build_page(
    network: Network,
    users: Users,
    rows: Rows,
    times: NDArray[np.int64],
    conflicts: list[Conflict],
    signals: list[dict[str, Any]],
    *,
    title: str,
    notes: list[str],
    marks_learned: bool,
) -> bytes:
    """The page as UTF-8. `signals`: see `signal_bars`. `marks_learned`: whether the trace marks background road users.

    Text of the trace is in the packed data only, which the page shows as text.
    """
    streams = pack(rows, times)
    vtypes = sorted(set(users.vtypes))
    number = {vtype: i for i, vtype in enumerate(vtypes)}
    listed = sorted(conflicts, key=lambda c: (c.kind != "collision", c.value if c.kind != "collision" else c.time))
    listed = sorted(listed[:MOST_CONFLICTS], key=lambda c: c.time)
    header: dict[str, Any] = {
        "title": title,
        "notes": notes,
        "marks_learned": marks_learned,
        "units": {"metre": METRE, "turn": HEADING_UNITS, "speed": SPEED_UNITS},
        "times": np.diff(times, prepend=0).tolist(),
        "types": TYPE_NAMES,
        "classes": CLASS_NAMES,
        "vtypes": vtypes,
        "users": {
            "id": users.ids,
            "vtype": [number[vtype] for vtype in users.vtypes],
            "kind": users.kind.tolist(),
            "length": np.round(users.length, 2).tolist(),
            "width": np.round(users.width, 2).tolist(),
            "class": [CLASS_NAMES.index(name) for name in users.classes],
        },
        "streams": [len(stream) for stream in streams],
        "conflicts": [
            [int(c.kind != "collision"), c.a, c.b, *(round(v, 2) for v in (c.time, c.end, c.x, c.y, c.value))]
            for c in listed
        ],
        "unlisted": len(conflicts) - len(listed),
        "definitions": DEFINITIONS,
        "ground": ground(network),
        "signals": signals,
    }
    head = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
    raw = len(head).to_bytes(4, "little") + head + b"".join(streams)
    squeeze = zlib.compressobj(9, zlib.DEFLATED, -15)
    data = base64.b64encode(squeeze.compress(raw) + squeeze.flush()).decode()

    folder = files("slrl_sumo.replay") / "assets"
    style = (folder / "page.css").read_text(encoding="utf-8")
    script = "".join((folder / name).read_text(encoding="utf-8") for name in SCRIPTS)
    page = (folder / "page.html").read_text(encoding="utf-8")
    # Only this script and this style are allowed, and nothing is fetched, for any content of a trace.
    policy = f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; base-uri 'none'"
    for name, text in (("title", html.escape(title)), ("policy", policy), ("style", style), ("script", script)):
        page = page.replace(f"<!--{name}-->", text)
    return page.replace("<!--data-->", data).encode()


def _hash(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def ground(network: Network) -> list[list[Any]]:
    """The network as the page draws it, in paint order: [what, width in m (0: an outline), x, y, x, y …] with the
    coordinates in cm, each less that of the point before."""
    shapes: list[list[Any]] = []
    rails = ((Ribbon(Surface.NONE, lane.shape, lane.width), lane) for lane in network.lanes if not lane.internal)
    for shape, lane in (*network.painted(), *(pair for pair in rails if pair[1].surface == Surface.NONE)):
        points = np.rint(100 * np.asarray(shape.points)).astype(np.int64)
        if len(points) < 2 or not len(points[0]):
            continue
        if isinstance(shape, Area):
            what = "junction" if lane is None or shape.surface == Surface.ROAD else "walkingarea"
            if lane is None and shape.surface != Surface.ROAD:
                what = shape.surface.name.lower()
            width = 0.0
        else:
            what, width = shape.surface.name.lower(), round(shape.width, 2)
            if lane is not None and lane.internal and shape.surface == Surface.ROAD:
                what = "junction"
            elif shape.surface == Surface.NONE:
                what, width = "rail", min(width, 1.5)
        shapes.append([what, width, *np.diff(points, axis=0, prepend=np.zeros((1, 2), np.int64)).ravel().tolist()])
    return shapes
