"""Compiled loops are compiled for one kind of arguments each: a second kind would stop a run for seconds, and two
processes that compile different kinds at once could take each other's."""

import json
import subprocess
import sys

import pytest

PROGRAM = """
import json, sys
from slrl_sumo.simulation.settings import RunSettings
from slrl_sumo.simulation.run import run
from slrl_sumo.scene import compiled

for settings in json.loads(sys.argv[1]):
    for event in run(RunSettings(**settings)):
        pass
kinds = {f"{f.py_func.__module__}.{f.py_func.__name__}": [str(kind) for kind in f.signatures]
         for f in compiled._KERNELS}
print(json.dumps(kinds))
"""

ALL = "car=1,bicycle=1,pedestrian=1"
RUNS = (
    # None at first, then few, then many.
    {"scenario": "district", "takeover": ALL, "steps": 60},
    {"scenario": "signalised", "takeover": ALL, "guard": True, "steps": 60, "step_length": 0.2},
    # One road user alone has arrays that are contiguous whichever way they are looked at.
    {"scenario": "intersection", "agents": 1, "guard": True, "steps": 40},
    {"scenario": "shared-space", "agents": 1, "bundle": "shared-space-paper", "steps": 20},
    {"scenario": "intersection", "agents": 20, "selector": "lane", "steps": 20},
    {"scenario": "intersection", "agents": 40, "selector": "sampled", "steps": 40},
)


@pytest.mark.slow
def test_nothing_is_compiled_twice() -> None:
    command = [sys.executable, "-c", PROGRAM, json.dumps(RUNS)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    kinds: dict[str, list[str]] = json.loads(done.stdout.splitlines()[-1])
    assert {name: seen for name, seen in kinds.items() if len(seen) > 1} == {}
    # They were there: of the motion, the lookahead, the images and the background.
    used = ("scene.advance._advance", "lookahead.collision._collision_scores", "perception.ego_image._draw_views")
    background = (
        "background.swept_conflicts._conflicts",
        "background.safe_speed.safe_speeds",
        "background.forecast._forecast",
    )
    assert [len(kinds[f"slrl_sumo.{name}"]) for name in (*used, *background)] == [1] * 6
