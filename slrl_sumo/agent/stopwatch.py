"""Wall time of the parts of a decision."""

from time import perf_counter

PARTS = ("read", "observe", "decide", "advance", "apply", "sumo", "record")
"""`read`: SUMO's road users into arrays, arrivals and takeovers; `observe`: routes, features, images, rollouts of all
modes; `decide`: the selector; `advance`: motion; `apply`: yielding and moves sent to SUMO; `sumo`: SUMO's own steps;
`record`: summary and trace."""


class Stopwatch:
    """Adds up the seconds of each of PARTS. What passes between two laps belongs to the second one, so that the parts
    make up all of the time since `take`; a lap costs less than a microsecond."""

    def __init__(self) -> None:
        self._seconds = dict.fromkeys(PARTS, 0.0)
        self._since = perf_counter()

    def lap(self, part: str) -> None:
        """Add the time since the last lap to `part`."""
        now = perf_counter()
        self._seconds[part] += now - self._since
        self._since = now

    def take(self) -> dict[str, float]:
        """The seconds of each part since this was asked last; the next ones begin now."""
        seconds, self._seconds = self._seconds, dict.fromkeys(PARTS, 0.0)
        self._since = perf_counter()
        return seconds
