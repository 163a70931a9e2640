"""Random runs of `slrl-sumo` in a scenario: its words, and the verdict on what they did."""

import gzip
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from random import Random
from typing import IO, Any, cast

from lxml import etree

from slrl_sumo.agent.constraints import Constraints
from slrl_sumo.netgen.binaries import binary
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.options import input_files
from tools.odd_demand import read_streets

BUNDLES = Path(__file__).parents[1] / "slrl_sumo" / "bundles"
RULES = tuple(rule.name for rule in fields(Constraints) if rule.name != "guard")
WORK = (6_000, 24_000)
"""Learned road users times decisions of a run, from and to."""
SPACE = 25.0
"""m of lanes for each spawned road user at least: fewer find no place."""
HANG = 600.0
"""s of wall clock after which a command counts as hung."""
PATIENCE = 20.0
"""s of wall clock after which plain SUMO counts as without an end: small scenarios without one pass hours in it."""
UNTIL = 300.0
"""s of simulation time of runs in such scenarios."""
FAILURES = ("traceback", "exit 3", "crash", "hang", "invalid output", "lost", "usage")


@dataclass
class Verdict:
    """What a command did."""

    words: list[str]
    outcome: str
    """ok, refused, SUMO refuses (plain SUMO does, too) or one of FAILURES."""
    detail: str = ""
    wall_s: float = 0.0
    figures: dict[str, int] = field(default_factory=dict)
    """From the summary."""

    @property
    def failed(self) -> bool:
        """Whether it is one of FAILURES."""
        return self.outcome in FAILURES

    @property
    def command(self) -> str:
        """The command line."""
        return shlex.join(["slrl-sumo", *self.words])


def draw_run(random: Random, scenario: Scenario, out: Path) -> list[str]:
    """The words of a `run` with random options, whose trace and summary go to `out`."""
    net = input_files(scenario, "net-file")[0]
    streets = read_streets(net)
    room = sum(length for street in streets.edges for _, _, _, length in street.lanes)
    agents = max(1, min(random.choice((1, 16, 48, 96, 160)), int(room / SPACE)))
    words = ["run", str(scenario.config), "--seed", str(random.randrange(1000))]
    motion = random.choice(("agents", "agents", "takeover", "takeover", "both"))
    if motion != "takeover":
        words += ["--agents", str(agents)]
    if motion != "agents":
        shares = {name: random.choice((0.3, 1.0, 1.0)) for name in ("car", "bicycle", "pedestrian")}
        words += ["--takeover", ",".join(f"{name}={share:g}" for name, share in shares.items())]
        words += _region(random, net)
    bundle = random.choice(sorted(folder.name for folder in BUNDLES.iterdir() if folder.is_dir()))
    trained = (BUNDLES / bundle / "selector.safetensors").exists()
    selector = random.choice(("prior", "lane", *(("greedy", "sampled") * trained)))
    words += ["--bundle", bundle, "--selector", selector]
    steps = random.randint(*WORK) // max(agents, 16)
    if random.random() < 0.95:
        words += ["--steps", str(min(steps, 600))]
    elif scenario.seconds("end") is None and not ends_by_itself(scenario):
        # The run would go on with plain SUMO's road users for ever.
        words += ["--until", f"{(scenario.seconds('begin') or 0.0) + UNTIL:g}"]
    for share, more in (
        (0.2 * (selector != "lane"), ["--guard"]),
        (0.2, ["--no-yield"]),
        (0.1, ["--without", random.choice(RULES)]),
        (0.1, ["--step-length", random.choice(("0.05", "0.1", "0.2", "0.4"))]),
        (0.1, ["--sumo-options", random.choice(("--lateral-resolution 0.8", "--scale 2", "--threads 2"))]),
    ):
        if random.random() < share:
            words += more
    trace = random.choice(("trace.xml", "trace.xml", "trace.xml.gz", "trace.csv", "trace.parquet"))
    return [*words, "--fcd", str(out / trace), "--summary", str(out / "summary.json"), "--quiet"]


def _region(random: Random, net: Path) -> list[str]:
    """The option --region, or nothing for everywhere."""
    root = etree.parse(net).getroot()
    junctions = [j for j in root.iter("junction") if j.get("type") != "internal"]
    at = random.choice(junctions)
    x, y = float(at.get("x", 0)), float(at.get("y", 0))
    edges = [str(edge.get("id")) for edge in root.iter("edge") if "from" in edge.attrib]
    return random.choice(
        (
            [],
            [],
            ["--region", f"junction:{at.get('id')},radius={random.choice((15, 60, 200))}"],
            ["--region", f"edges:{','.join(random.sample(edges, min(3, len(edges))))}"],
            ["--region", f"box:{x - 40:g},{y - 40:g},{x + 40:g},{y + 40:g}"],
        )
    )


def draw_others(random: Random, scenario: Scenario, out: Path) -> list[list[str]]:
    """The words of further commands on the same scenario: one in half of the runs."""
    config = str(scenario.config)
    few = ["--seed", str(random.randrange(1000))]
    few += ["--bundle", "intersection"]
    episodes = ["--agents", "4", "--episodes", "2", "--steps", "10"]
    others = (
        ["doctor", config],
        ["doctor", config],
        ["record", config, "--out", str(out / "recording.npz"), "--seconds", "20", *few[:2]],
        ["evaluate", config, "--out", str(out / "evaluation"), *episodes, *few],
        ["compare", config, "--out", str(out / "comparison"), "--seeds", "1", "--steps", "25", *few],
    )
    return [random.choice(others)] if random.random() < 0.5 else []


def execute(words: list[str], scenario: Scenario, limit: float = HANG) -> Verdict:
    """Run `slrl-sumo` with `words` in a process group of its own."""
    begin = time.perf_counter()
    command = [sys.executable, "-X", "faulthandler", "-m", "slrl_sumo", *words]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            _, errors = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return Verdict(words, "hang", f"no end after {limit:g} s", limit)
    verdict = Verdict(words, *judged(process.returncode, errors, scenario), time.perf_counter() - begin)
    if verdict.outcome == "ok" and words[0] == "run":
        _check_outputs(verdict)
    return verdict


def judged(code: int, errors: str, scenario: Scenario) -> tuple[str, str]:
    """The outcome of a command by its exit code and what it wrote to stderr, and a line about it."""
    lines = [line for line in errors.splitlines() if line.strip()]
    last = next((line for line in reversed(lines) if line.startswith("slrl-sumo:")), lines[-1] if lines else "")
    if code == 2:
        return "usage", errors
    if "Traceback" in errors or code == 4:
        return "traceback", "\n".join(lines[-25:])
    if code < 0 or code > 128:
        return "crash", f"{signal.Signals(-code if code < 0 else code - 128).name}: {last}"
    if code in (1, 3):
        plain = _plain_sumo(scenario)
        if plain:
            return "SUMO refuses", plain
        return ("exit 3" if code == 3 else "refused"), last
    return ("ok", "") if code == 0 else ("refused", last)


def ends_by_itself(scenario: Scenario) -> bool:
    """Whether plain SUMO comes to the end of a scenario that gives none: persons may wait for ever, vehicles jam."""
    return _plain(scenario, PATIENCE) is not None


def _plain(scenario: Scenario, patience: float, *options: str) -> subprocess.CompletedProcess[str] | None:
    """Plain SUMO in the scenario, without teleports as in runs; None where it has not ended after `patience` s."""
    more = ["--no-step-log", "--no-warnings", "--time-to-teleport", "-1", *options]
    command = [binary("sumo"), "-c", str(scenario.config), *more]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=patience, check=False)
    except subprocess.TimeoutExpired:
        return None


def _plain_sumo(scenario: Scenario) -> str:
    """What plain SUMO says where it cannot run the scenario either; else ''."""
    done = _plain(scenario, HANG, "--end", f"{(scenario.seconds('begin') or 0.0) + 120:g}")
    if done is None:
        return ""
    lines = [line for line in done.stderr.splitlines() if line.startswith("Error")]
    return (lines[0] if lines else f"exit code {done.returncode}") if done.returncode else ""


def _check_outputs(verdict: Verdict) -> None:
    """Read summary and trace; the verdict changes where they are invalid, or where a road user was lost."""
    words = verdict.words
    summary: dict[str, Any] = json.loads(Path(words[words.index("--summary") + 1]).read_text())
    names = ("agent_steps", "decisions", "lost", "refused", "taken_over", "handed_back", "arrived", "returned_to_route")
    verdict.figures = {name: int(summary[name]) for name in names}
    trace = Path(words[words.index("--fcd") + 1])
    substeps = round(summary["decision_interval_s"] / summary["sumo_step_s"])
    if ".xml" in trace.name:
        spawned = int(words[words.index("--agents") + 1]) if "--agents" in words else 0
        removed = [refusal["time_s"] for refusal in summary["refusals"] if refusal["id"].startswith("learned_")]
        wrong = wrong_trace(trace, 1 + summary["decisions"] * substeps, spawned, removed)
        if wrong:
            verdict.outcome, verdict.detail = "invalid output", wrong
    if summary["lost"]:
        verdict.outcome, verdict.detail = "lost", json.dumps(summary["losses"][:5])


def wrong_trace(trace: Path, steps: int, spawned: int, removed: Sequence[float] = ()) -> str:
    """What is wrong with an FCD file that should have a number of time steps, each with all spawned road users.

    `removed`: times (s) at which calls for some of them were refused; they may be missing from then on.
    """
    found = 0
    try:
        with cast(IO[bytes], gzip.open(trace)) if trace.suffix == ".gz" else trace.open("rb") as stream:
            for _, element in etree.iterparse(stream, tag="timestep"):
                found += 1
                ours = sum(user.get("id", "").startswith("learned_") for user in element)
                now = float(element.get("time", 0))
                if not spawned - sum(time <= now for time in removed) <= ours <= spawned:
                    return f"{ours} of {spawned} spawned road users at {element.get('time')} s"
                element.clear()
    except (OSError, EOFError, etree.XMLSyntaxError) as error:
        return f"not well-formed after {found} time steps: {error}"
    return "" if found == steps else f"{found} time steps, not {steps}"
