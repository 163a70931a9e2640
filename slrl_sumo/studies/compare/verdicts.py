"""Conclusions from the confidence interval of a difference."""

from collections.abc import Mapping, Sequence
from typing import Any

MORE, LESS, SAME, UNKNOWN, EQUAL = "higher", "lower", "no difference shown", "too few seeds", "the same"


def verdict(row: Mapping[str, Any], first: str) -> str:
    """Of a row of `tables.rows`; `first`: the arm that the other one is compared with.

    An interval without 0 says the sign. One with 0 says that no difference was shown, unless it is so wide that it says
    nothing: it reaches from less than -50 % to more than +50 % of the first arm's figure, or there is none (one seed).
    """
    low, high, own = row["difference_low"], row["difference_high"], abs(row[first])
    if low is None:
        return UNKNOWN
    if low > 0.0 or high < 0.0:
        return MORE if low > 0.0 else LESS
    return UNKNOWN if high - low > own > 0.0 or (own == 0.0 and high > low) else SAME


def sign(difference: float) -> str:
    """Conclusion from a difference between single runs, which have no interval."""
    if difference == 0.0:
        return EQUAL
    return MORE if difference > 0.0 else LESS


def too_few(rows: Sequence[Mapping[str, Any]], seeds: int) -> str:
    """A sentence on inconclusive intervals; '' if all intervals are conclusive."""
    silent = sum(row["verdict"] == UNKNOWN for row in rows)
    if not silent:
        return ""
    count = f"{seeds} seed{' is' if seeds == 1 else 's are'} too few"
    return f"{count} for {silent} of {len(rows)} lines, whose intervals are too wide to say anything; give more seeds."
