"""Memory of the process."""

import re
import resource
import sys
from pathlib import Path

STATUS = Path("/proc/self/status")


def peak_memory_mib() -> float:
    """Greatest resident memory of this process so far, MiB.

    On Linux it is VmHWM of https://man7.org/linux/man-pages/man5/proc_pid_status.5.html: `ru_maxrss` survives exec, so
    that a small child of a process of 600 MiB reports 600 MiB.
    """
    if STATUS.exists() and (found := re.search(r"^VmHWM:\s*(\d+) kB", STATUS.read_text(), re.MULTILINE)):
        return int(found[1]) / 1024.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024.0**2 if sys.platform == "darwin" else 1024.0)
