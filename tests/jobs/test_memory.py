import subprocess
import sys

import numpy as np

from slrl_sumo.jobs.memory import peak_memory_mib


def test_the_peak_stays_when_memory_is_released() -> None:
    before = peak_memory_mib()
    np.ones(40 << 20, np.uint8).sum()
    now = peak_memory_mib()
    assert now > 10.0
    assert now >= before


def test_a_small_child_of_a_large_process_does_not_report_its_parent() -> None:
    held = np.ones(300 << 20, np.uint8)
    text = "from slrl_sumo.jobs.memory import peak_memory_mib; print(peak_memory_mib())"
    child = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True, close_fds=False)
    assert 5.0 < float(child.stdout) < held.nbytes / 2**20
