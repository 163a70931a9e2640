"""Kernels that other processes compile."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import typeof, types

from slrl_sumo.scene.compile_ahead import named, parsed, recorded, spelled
from slrl_sumo.scene.levels import FLAT
from tools.record_signatures import RUNS, called_in

PROGRAM = """
import json
from slrl_sumo.scene import compile_ahead
from slrl_sumo.scene.compiled import _KERNELS
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings
for _ in run(RunSettings(scenario="intersection", agents=16, steps=1)):
    pass
print(json.dumps({
    "others": len(compile_ahead._Process.others),
    "loaded": sum(sum(kernel.stats.cache_hits.values()) for kernel in _KERNELS),
    "compiled": sum(sum(kernel.stats.cache_misses.values()) for kernel in _KERNELS),
}))
"""


@pytest.mark.parametrize(
    "argument",
    [
        1,
        0.5,
        True,
        np.zeros(3),
        np.zeros((2, 3), np.float32),
        np.zeros((4, 6))[::2, ::2],
        np.zeros(2, np.bool_),
        np.broadcast_to(np.float64(1.0), 3),
        (1, 2.0),
        (np.zeros(1), np.zeros(1)),
        FLAT,
    ],
)
def test_types_of_arguments_are_read_as_they_were_written(argument: object) -> None:
    one = typeof(argument)
    assert parsed(json.loads(json.dumps(spelled(one)))) == one


def test_arrays_of_another_layout_are_another_type() -> None:
    assert spelled(typeof(np.zeros((4, 6)))) == "float64 2 C"
    assert spelled(typeof(np.zeros((4, 6))[::2])) == "float64 2 A"
    assert parsed("float64 2 A") == types.Array(types.float64, 2, "A")


def test_what_a_run_calls_is_recorded() -> None:
    for name, signatures in called_in(RUNS[0]).items():
        for signature in signatures:
            assert signature in recorded()[name], f"{name}: run tools/record_signatures.py"


def test_every_recorded_kernel_exists_and_takes_these_arguments() -> None:
    for name, signatures in recorded().items():
        for signature in signatures:
            assert len(signature) == named(name).py_func.__code__.co_argcount
            assert [spelled(parsed(one)) for one in signature] == signature


@pytest.mark.slow
@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core compiles as fast by itself")
def test_on_the_first_run_other_processes_compile(tmp_path: Path) -> None:
    # The name of a processor leaves out the machine code that came with the package.
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_CPU_NAME": "generic"}
    command = [sys.executable, "-W", "error", "-c", PROGRAM]
    done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    first = json.loads(done.stdout.splitlines()[-1])
    assert first["others"] >= 2
    assert first["compiled"] == 0
    assert first["loaded"] >= 25
