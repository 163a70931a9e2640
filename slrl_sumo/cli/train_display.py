"""Progress of a training on the terminal."""

import math
import signal

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from slrl_sumo.jobs.progress import bar_console
from slrl_sumo.learning.rl.train import TrainRequest, train
from slrl_sumo.learning.rl.training_log import Figures
from slrl_sumo.learning.rl.training_settings import TrainSettings

_RESEMBLE = {
    "random": "district",
    "town": "district",
    "motorway": "district",
    "roundabout": "intersection",
    "signals": "signalised",
}
"""Families, and the shipped scenarios that resemble them most."""
LINE_EVERY = 20
"""Updates between two lines of output if stderr is no terminal."""


def train_with_progress(request: TrainRequest, settings: TrainSettings, *, resume: bool) -> int:
    """Train as `slrl_sumo.learning.rl.train.train` does. Returns 0, or the number of the signal that stopped it."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[figures]}"), TimeElapsedColumn())
    with Progress(*columns, TimeRemainingColumn(), console=bar_console(), disable=not console.is_terminal) as bar:
        task = bar.add_task("training", total=None, figures="")
        updates = 0

        def report(stage: str, done: int, total: int, figures: Figures) -> None:
            nonlocal updates
            text = _text(stage, figures)
            bar.update(task, description=stage, completed=done, total=total, figures=text)
            if not console.is_terminal and (updates % LINE_EVERY == 0 or done == total):
                console.print(f"{stage}: {done}/{total}  {text}", soft_wrap=True, highlight=False)
            updates += 1

        try:
            train(request, settings, resume=resume, report=report)
        except KeyboardInterrupt as interrupt:
            console.print(f"stopped; --resume continues from the last checkpoint in {request.folder}")
            return int(interrupt.args[0]) if interrupt.args else signal.SIGINT
    return 0


def closing_scenario(trained_in: str) -> str:
    """Scenario in which a selector trained in `trained_in` is evaluated.

    The first scenario of that list, or for a family of generated networks the shipped scenario that resembles them and
    was not among them.
    """
    first = trained_in.split(",")[0].strip()
    return _RESEMBLE.get(first, first)


def _text(stage: str, figures: Figures) -> str:
    """The most important figures, in one line."""
    if stage == "training":
        rate, mean_return = figures["speed/agent_steps_per_s"], figures["episode/return"]
        text = (
            f"{rate:.0f} steps/s  return {_shown(mean_return, '.2f')}  reward {_shown(figures['reward/total'], '.3f')}"
        )
        if "trips/reached" not in figures:
            return f"{text}  completed {_shown(figures['episode/completed'], '.0%')}"
        contacts, off = (-1000.0 * figures.get(f"reward/{name}", 0.0) for name in ("contact", "off_surface"))
        reached, clean = _shown(figures["trips/reached"], ".0%"), _shown(figures["trips/clean"], ".1%")
        text = f"{text}  {reached} reached  {clean} of them clean  contacts {_shown(contacts, '.2f')}"
        return f"{text}  off-surface penalty {_shown(off, '.1f')} per 1,000 steps"
    if stage == "imitation":
        right, by_prior = figures["imitation/accuracy"], figures["imitation/prior_accuracy"]
        return f"{right:.0%} of modes predicted, {by_prior:.0%} by the prior"
    return ""


def _shown(value: float, form: str) -> str:
    """A figure as text: a dash where no episode has ended yet, and no sign at zero."""
    return "–" if math.isnan(value) else f"{value:z{form}}"
