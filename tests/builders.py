"""Builders of what tests of several packages need: worlds, routes, recordings and random bundles."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.models.bundle import ModelBundle, weights_of
from slrl_sumo.models.bundle_config import BundleConfig
from slrl_sumo.models.displacement import DisplacementModels
from slrl_sumo.models.prior import Prior
from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.perception.features import STATES
from slrl_sumo.routing.lane_path import LanePath
from slrl_sumo.routing.vehicle_track import VehicleHistory, VehicleTrack
from slrl_sumo.scene.levels import Levels
from slrl_sumo.scene.route import HERE, POINTS, SPACING, RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH, RoadUserType
from slrl_sumo.sumo.network.lanes import Lane
from slrl_sumo.sumo.road_users import VehicleParameters

ALONG = SPACING * (np.arange(POINTS, dtype=np.float64) - HERE)
"""m along a path from the road user to each of its points, (POINTS,)."""


def make_net(folder: Path, nodes: str, edges: str, *options: str) -> Path:
    """A SUMO network of `<node>` and `<edge>` elements, by netconvert."""
    (folder / "n.nod.xml").write_text(f"<nodes>{nodes}</nodes>")
    (folder / "n.edg.xml").write_text(f"<edges>{edges}</edges>")
    run_program("netconvert", ["-n", "n.nod.xml", "-e", "n.edg.xml", *options, "-o", "n.net.xml"], folder)
    return folder / "n.net.xml"


def make_scenario(folder: Path, nodes: str, edges: str, users: str, *options: str, settings: str = "") -> Path:
    """A scenario on such a network, with the elements `users` of a route file and more `settings` of its .sumocfg."""
    make_net(folder, nodes, edges, *options)
    (folder / "n.rou.xml").write_text(f"<routes>{users}</routes>")
    files = '<net-file value="n.net.xml"/><route-files value="n.rou.xml"/>'
    (folder / "n.sumocfg").write_text(f"<configuration>{files}{settings}</configuration>")
    return folder / "n.sumocfg"


def make_crossroads(
    folder: Path, users: str, *options: str, centre: str = "", lanes: int = 1, settings: str = ""
) -> Path:
    """As make_scenario: a junction "c", 100 m from the ends "w", "e", "s" and "n" of its arms. Edges are named by their
    two nodes, as "wc"; `centre`: attributes of the junction; `lanes`: of each edge."""
    ends = {"w": (-100, 0), "e": (100, 0), "s": (0, -100), "n": (0, 100)}
    nodes = f'<node id="c" x="0" y="0" {centre}/>'
    nodes += "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, (x, y) in ends.items())
    edges = "".join(
        f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="{lanes}"/>'
        for name in ends
        for a, b in ((name, "c"), ("c", name))
    )
    return make_scenario(folder, nodes, edges, users, *options, settings=settings)


def make_lane(
    name: str, *points: tuple[float, float], max_speed: float = 13.9, surface: Surface = Surface.ROAD
) -> Lane:
    """A lane 3.2 m wide through these points (m), of the junction or edge that its id names; `max_speed`: m/s."""
    shape = np.array(points, np.float64)
    length = float(np.hypot(*np.diff(shape, axis=0).T).sum())
    edge = name.rpartition("_")[0]
    return Lane(name, edge, shape, 3.2, length, max_speed, frozenset(), name.startswith(":"), surface)


def make_world(
    x: ArrayLike = 0.0,
    y: ArrayLike = 0.0,
    heading: ArrayLike = 0.0,
    speed: ArrayLike = 0.0,
    *,
    type: ArrayLike = 0,
    acceleration: ArrayLike = 0.0,
    yaw_rate: ArrayLike = 0.0,
    length: ArrayLike | None = None,
    width: ArrayLike | None = None,
    learned: ArrayLike = True,
    ids: Sequence[str] | None = None,
    time: float = 0.0,
) -> WorldState:
    """A world of columns; a number stands for a column of it.

    The world has as many road users as the longest column, or as there are `ids`. Unless given otherwise, they are
    learned cars with the ids "0", "1", …, and boxes have the default size of their type.
    """
    columns = (x, y, heading, speed, type, acceleration, yaw_rate, learned, length, width)
    shapes = [np.shape(column) for column in columns if column is not None]
    shape = np.broadcast_shapes((1,) if ids is None else (len(ids),), *shapes)

    def column(values: ArrayLike, kind: Any = np.float64) -> NDArray[Any]:
        return np.broadcast_to(np.asarray(values, kind), shape).copy()

    kinds = column(type, np.int8)
    return WorldState(
        time=time,
        ids=tuple(str(i) for i in range(shape[0])) if ids is None else tuple(ids),
        type=kinds,
        x=column(x),
        y=column(y),
        heading=column(heading),
        speed=column(speed),
        acceleration=column(acceleration),
        yaw_rate=column(yaw_rate),
        length=column(DEFAULT_LENGTH[kinds] if length is None else length),
        width=column(DEFAULT_WIDTH[kinds] if width is None else width),
        learned=column(learned, np.bool_),
    )


def make_levels() -> Levels:
    """A street eastwards along y = 0, on level 1, that crosses one northwards along x = 0, on level 2: 20 m of each."""
    s = np.arange(-20.0, 21.0, 2.0)
    zero, one = np.zeros(len(s)), np.ones(len(s))
    table = np.concatenate([np.stack([s, zero, one, zero, one]), np.stack([zero, s, zero, one, 2.0 * one])], axis=1)
    x, y, cos, sin, level = table[:, np.argsort(table[0], kind="stable")]
    return Levels(x, y, cos, sin, level.astype(np.int8))


def make_crowd(n: int, seed: int, side: float, corner: float = 0.0) -> WorldState:
    """`n` learned road users of all types at random in a square of `side` m with its lower left at (corner, corner)."""
    random = np.random.default_rng(seed)
    sizes = np.array([[5.0, 1.8], [1.6, 0.65], [0.5, 0.5]])
    kind = random.integers(0, 3, n)
    x, y = random.uniform(corner, corner + side, n), random.uniform(corner, corner + side, n)
    heading, speed = random.uniform(-np.pi, np.pi, n), random.uniform(0.0, 8.0, n)
    turning = random.normal(0.0, 0.3, n)
    return make_world(x, y, heading, speed, type=kind, yaw_rate=turning, length=sizes[kind, 0], width=sizes[kind, 1])


def put_head_on(users: WorldState) -> tuple[WorldState, int, int]:
    """`users` with their first two cars 8 m from each other, driving towards each other at 8 m/s; and their rows."""
    a, b = np.flatnonzero(users.type == RoadUserType.CAR)[:2]
    x, y, heading, speed = users.x.copy(), users.y.copy(), users.heading.copy(), users.speed.copy()
    x[b], y[b] = x[a] + 8.0 * np.cos(heading[a]), y[a] + 8.0 * np.sin(heading[a])
    heading[b] = heading[a] + np.pi
    speed[[a, b]] = 8.0
    return replace(users, x=x, y=y, heading=heading, speed=speed), int(a), int(b)


def make_routes(x: ArrayLike, y: ArrayLike = 0.0, *, known: ArrayLike = True, **columns: ArrayLike) -> RouteAhead:
    """Routes of n road users. `x`, `y`: points of their paths, (n, POINTS), or what broadcasts to that; `columns`:
    other fields of RouteAhead, (n,) or one number; those not given are as of a road user without a route."""
    paths = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64), np.zeros((1, POINTS)))
    route = RouteAhead.unknown(len(paths[0]))
    for name, values in {"x": paths[0], "y": paths[1], "known": known, **columns}.items():
        getattr(route, name)[:] = values
    return route


def straight_routes(
    *places: tuple[float, float, float], turn: float = 0.0, after: int = 0, **columns: ArrayLike
) -> RouteAhead:
    """Routes of road users at places (x, y, heading): straight paths that turn by `turn` rad `after` m.

    `columns`: as of `make_routes`.
    """
    here = np.array(places, np.float64).reshape(-1, 3).T[:, :, None]
    heading = here[2] + np.where(np.arange(POINTS - 1) >= HERE + after, turn, 0.0)
    lines = []
    for begin, step in zip(here[:2], (np.cos(heading), np.sin(heading)), strict=True):
        line = np.concatenate([np.zeros((len(begin), 1)), SPACING * np.cumsum(step, axis=1)], axis=1)
        lines.append(line + begin - line[:, HERE : HERE + 1])
    return make_routes(*lines, **columns)


def make_track(path: LanePath, s: float, speed: float, edges: tuple[str, ...] = ()) -> VehicleTrack:
    """A car with its front `s` m along a path, as SUMO's usual one."""
    return VehicleTrack(
        path=path,
        s=s,
        lateral_offset=0.0,
        speed=speed,
        x=0.0,
        y=0.0,
        edges=edges,
        parameters=VehicleParameters("passenger", 2.6, 4.5, 9.0, 13.9, 1.0, 1.0),
        history=VehicleHistory(),
    )


def with_history(track: VehicleTrack, **fields: Any) -> VehicleTrack:
    """The track with other entries in its history."""
    return replace(track, history=replace(track.history, **fields))


def make_recording(
    *tracks: tuple[ArrayLike, ArrayLike, ArrayLike],
    first: ArrayLike = 0,
    type: ArrayLike = 0,
    length: ArrayLike | None = None,
    width: ArrayLike | None = None,
    ids: Sequence[str] | None = None,
    **fields: Any,
) -> Trajectories:
    """A recording of tracks, each given by x, y (m) and heading (rad) in its frames; numbers stand for columns.

    `first`: first frame of each track, or of all. Boxes have the default size of the type unless given, ids are "t0",
    "t1", …; `fields`: other fields of Trajectories.
    """
    n = len(tracks)
    poses = [np.stack(np.broadcast_arrays(*(np.asarray(v, np.float64) for v in track)), -1) for track in tracks]
    pose = np.concatenate([np.zeros((0, 3)), *poses])
    lengths = np.array([len(rows) for rows in poses], np.int64)
    kinds = np.broadcast_to(np.asarray(type, np.int8), n).copy()
    firsts = np.broadcast_to(np.asarray(first, np.int64), n)
    frames = [begin + np.arange(rows) for begin, rows in zip(firsts, lengths, strict=True)]
    return Trajectories(
        track=np.repeat(np.arange(n), lengths),
        frame=np.concatenate([np.zeros(0, np.int64), *frames]),
        x=pose[:, 0].copy(),
        y=pose[:, 1].copy(),
        heading=pose[:, 2].copy(),
        ids=tuple(f"t{i}" for i in range(n)) if ids is None else tuple(ids),
        type=kinds,
        length=np.broadcast_to(DEFAULT_LENGTH[kinds] if length is None else np.asarray(length, np.float64), n).copy(),
        width=np.broadcast_to(DEFAULT_WIDTH[kinds] if width is None else np.asarray(width, np.float64), n).copy(),
        **fields,
    )


def make_bundle(preset: str = "paper") -> ModelBundle:
    """A bundle of random weights: every layer, bias, scale and bound has an effect, and the modes differ.

    `preset`: of the vector that its models read.
    """
    generator = torch.Generator().manual_seed(7)
    displacement, prior = (
        DisplacementModels(hidden=(8, 6), inputs=len(STATES[preset])),
        Prior(hidden=(10, 8), inputs=len(STATES[preset])),
    )
    for module in (displacement, prior):
        for parameter in (*module.parameters(), module.networks.mean):
            with torch.no_grad():
                parameter.copy_(torch.randn(parameter.shape, generator=generator))
        module.networks.scale.copy_(torch.rand(3, len(STATES[preset]), generator=generator))
    displacement.acceleration_bounds.copy_(torch.tensor([[-4.0, 3.0], [-3.0, 2.0], [-1.5, 1.0]]))
    displacement.yaw_rate_bounds.copy_(torch.tensor([[-0.7, 0.6], [-0.8, 0.9], [-2.0, 1.5]]))
    displacement.max_curvature.copy_(torch.tensor([0.2, 0.5, 3.0]))
    displacement.max_speed.copy_(torch.tensor([15.0, 8.0, 2.5]))
    random = np.random.default_rng(7)
    return ModelBundle(
        name="random",
        config=BundleConfig(preset=preset, features=STATES[preset], displacement_hidden=(8, 6), prior_hidden=(10, 8)),
        mode_centres=random.normal(0.0, 10.0, (3, 20, 2)),
        mode_counts=random.integers(1, 100, (3, 20)),
        weights=weights_of(displacement, prior),
        training={"seed": 7, "types": {"car": {"windows": 12}}},
        card="# Model bundle `random`\n\nNo data was used for these weights, süß.\n",
    )
