"""Plain SUMO traffic of many seeds, recorded side by side: a file of trajectories for each."""

import json
import sys
import time
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.input_files import read_json
from slrl_sumo.jobs.interrupt import interruptible
from slrl_sumo.jobs.pool import Backend, Finished, portable_name, run_jobs
from slrl_sumo.jobs.progress import progress as progress_bar
from slrl_sumo.simulation.record import recorded_whole
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.version import __version__


@dataclass(frozen=True)
class Recordings:
    """Settings of recordings, named as the options of `slrl-sumo record`."""

    scenario: str
    seeds: range
    seconds: float = 600.0
    step_length: float | None = None


def write_recordings(wanted: Recordings, folder: Path, backend: Backend) -> int:
    """Record every seed that `folder` does not contain yet, with a progress bar, as seed-N.npz.

    Returns 0, or the number of the signal that interrupted it; the recordings finished by then are kept. Raises
    InputError where the input is wrong or the folder is of other recordings, SumoError where seeds failed.
    """
    if not wanted.seeds:
        raise InputError(f"--seeds {len(wanted.seeds)}: give a whole number, 1 or more")
    scenario = find_scenario(wanted.scenario)
    _check_folder(wanted, scenario.name, folder)
    missing = (seed for seed in wanted.seeds if not _file(folder, seed).exists())
    work = partial(recorded_whole, portable_name(wanted.scenario), wanted.seconds, wanted.step_length)
    failed: list[Finished[int, Trajectories]] = []
    empty: list[int] = []
    with interruptible() as caught, progress_bar("{task.fields[rate]:.2f} recordings/s") as bar:
        done = sum(_file(folder, seed).exists() for seed in wanted.seeds)
        task = bar.add_task(scenario.name, total=len(wanted.seeds), completed=done, rate=0.0)
        begin = time.perf_counter()
        try:
            with closing(run_jobs(work, missing, backend)) as results:
                for number, finished in enumerate(results, start=1):
                    if finished.record is None:
                        failed.append(finished)
                    else:
                        finished.record.save(_file(folder, finished.job))
                        empty += [] if len(finished.record) else [finished.job]
                    bar.update(task, advance=1, rate=number / (time.perf_counter() - begin))
        except KeyboardInterrupt:
            bar.stop()
            print("interrupted: the same command continues after the finished recordings", file=sys.stderr)
            return caught[0]
    for each in failed:
        print(
            f"left out: seed {each.job}: {each.reason}; to repeat it: slrl-sumo record {wanted.scenario} "
            f"--seconds {wanted.seconds:g} --seed {each.job} --out seed-{each.job}.npz",
            file=sys.stderr,
        )
    print(f"{folder}: {len(wanted.seeds) - len(failed)} recordings of {wanted.seconds:g} s")
    if empty:
        print(
            f"note: {len(empty)} of them hold no road user, as {_file(folder, min(empty))}; give more --seconds",
            file=sys.stderr,
        )
    if failed:
        raise SumoError(f"{len(failed)} of {len(wanted.seeds)} seeds could not be recorded")
    return 0


def _file(folder: Path, seed: int) -> Path:
    return folder / f"seed-{seed}.npz"


def _check_folder(wanted: Recordings, name: str, folder: Path) -> None:
    """Make the folder, or check that its recordings have the same settings."""
    header = {"version": __version__, "scenario": name, "seconds": wanted.seconds, "step_length": wanted.step_length}
    file = folder / "recordings.json"
    try:
        folder.mkdir(exist_ok=True)
        if not file.exists():
            file.write_text(json.dumps(header) + "\n", encoding="utf-8")
        found = read_json(file)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}); name another --out") from None
    except ValueError:
        raise InputError(f"{file}: is damaged or something else; name another --out, or delete it") from None
    if found != header:
        raise InputError(f"{folder}: its recordings are of other settings ({found}); name another --out")
