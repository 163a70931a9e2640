"""A replay page of many road users: python benchmarks/make_large_replay.py OUT.html [--users 3000] [--seconds 3600]

The road users are not simulated: each goes to and fro along one lane of a grid of 256 junctions with signals, in steps
of 1 s. For benchmarks/measure_replay.py.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import sumo

from slrl_sumo.formats.signal_states import read_signals
from slrl_sumo.replay.compact import Rows
from slrl_sumo.replay.page import Users, build_page
from slrl_sumo.replay.signal_bars import signal_bars
from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.sumo.net_file import read_net_signals

GRID = "--grid --grid.number 16 --grid.length 150 --default.lanenumber 2 --default-junction-type traffic_light"
RNG = np.random.default_rng(1)


def main() -> None:
    """Draw the grid, record its signals, place the road users and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--users", type=int, default=3000)
    parser.add_argument("--seconds", type=int, default=3600)
    words = parser.parse_args()
    tools = Path(sumo.SUMO_HOME) / "bin"
    with tempfile.TemporaryDirectory() as folder:
        net, states = Path(folder) / "grid.net.xml", Path(folder) / "tls.xml"
        subprocess.run([tools / "netgenerate", *GRID.split(), "-o", net], check=True, capture_output=True)
        network, links = read_net_signals(net)
        events = "".join(
            f'<timedEvent type="SaveTLSStates" source="{signal}" dest="{states}"/>'
            for signal in sorted({link.signal for link in links})
        )
        extra = Path(folder) / "events.add.xml"
        extra.write_text(f"<additional>{events}</additional>")
        end = str(words.seconds)
        subprocess.run([tools / "sumo", "-n", net, "-a", extra, "--end", end], check=True, capture_output=True)
        bars = signal_bars(network, links, read_signals(states))
    lanes = [lane for lane in network.lanes if not lane.internal]
    chosen = RNG.integers(len(lanes), size=words.users)
    first, last = (np.array([lanes[k].shape[end] for k in chosen]) for end in (0, -1))
    reach = np.hypot(*(last - first).T)
    speed = RNG.uniform(3, 14, words.users)
    t = np.arange(words.seconds)
    phase = (RNG.uniform(0, 2, words.users)[:, None] + speed[:, None] * t / reach[:, None]) % 2
    share = np.where(phase < 1, phase, 2 - phase)
    x, y = (first[:, k, None] + share * (last - first)[:, k, None] for k in (0, 1))
    ahead = np.arctan2(*(last - first).T[::-1])
    n = words.users * len(t)
    rows = Rows(
        user=np.repeat(np.arange(words.users), len(t)),
        step=np.tile(t, words.users),
        x=x.ravel(),
        y=y.ravel(),
        heading=np.where(phase < 1, ahead[:, None], ahead[:, None] + np.pi).ravel(),
        speed=np.repeat(speed, len(t)),
        state=np.repeat(np.arange(words.users) % 3 == 0, len(t)).astype(np.int64),
    )
    unknown = ("",) * words.users
    kind = (np.arange(words.users) % len(TYPE_NAMES)).astype(np.int8)
    size = np.array([[4.5, 1.8], [1.8, 0.6], [0.5, 0.5]])[kind]
    ids = tuple(f"user.{k}" for k in range(words.users))
    users = Users(ids, unknown, kind, size[:, 0], size[:, 1], unknown)
    page = build_page(network, users, rows, 1000 * t, [], bars, title=words.out.stem, notes=[], marks_learned=True)
    words.out.write_bytes(page)
    print(f"{n} rows, {len(page) / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
