"""Times as SUMO writes them."""


def parse_time(text: str | None) -> float | None:
    """Seconds from SUMO's [days:]hours:minutes:seconds or a number; None for words such as 'triggered'."""
    try:
        parts = [float(part) for part in (text or "").split(":")]
    except ValueError:
        return None
    return sum(part * scale for part, scale in zip(reversed(parts), (1, 60, 3600, 86400), strict=False))
