"""A training as people see it: progress while it runs, and what it came to."""

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from slrl_sumo.learning.train import Figures, TrainRequest, train
from slrl_sumo.learning.train_settings import TrainSettings

LINE_EVERY = 20
"""Updates between two lines where there is no terminal to draw a bar on."""


def train_with_progress(request: TrainRequest, settings: TrainSettings, *, resume: bool) -> bool:
    """Train as `slrl_sumo.learning.train.train` does. Returns False where the user stopped it (Ctrl-C)."""
    console = Console(stderr=True)
    columns = (TextColumn("training"), BarColumn(), TextColumn("{task.fields[figures]}"), TimeElapsedColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("training", total=None, figures="")
        updates = 0

        def report(done: int, total: int, figures: Figures) -> None:
            nonlocal updates
            text = (
                f"{figures['speed/agent_steps_per_s']:.0f} steps/s  return {figures['episode/return']:.2f}  "
                f"success {figures['episode/success']:.0%}"
            )
            bar.update(task, completed=done, total=total, figures=text)
            if not console.is_terminal and (updates % LINE_EVERY == 0 or done == total):
                console.print(f"{done}/{total} steps  {text}", soft_wrap=True, highlight=False)
            updates += 1

        try:
            train(request, settings, resume=resume, report=report)
        except KeyboardInterrupt:
            console.print(f"stopped; go on from the last checkpoint in {request.folder} with --resume")
            return False
    return True
