"""The published figures for comparison: Tables 1 and 2 of the paper (section 4.2)."""

from typing import Any

MEASURED_ELSEWHERE = (
    "published figures, measured elsewhere: other scenes, other simulator. Speeds are as printed, in m/s by the "
    "table's head; those of the paper's own models are probably metres per step of 0.4 s (its code never divides)"
)

TABLES = {"intersection": ("Table 1", "inD"), "shared-space": ("Table 2", "uniD")}
"""Which table belongs to which kind of scenario, and the recordings that it is about."""

Triple = tuple[float | None, float | None, float | None]

# Pedestrians, bicycles, cars. The survival printed for recorded road users is in frames of 25 Hz and counts those in
# which they are absent, so it is left out.
_PRINTED: tuple[tuple[str, str, Triple, tuple[float, float], Triple, Triple], ...] = (
    ("Table 1", "SL", (0.5, 3.7, 5.9), (28, 25), (107, 78, 59), (26, 40, 31)),
    ("Table 1", "SL+RL", (0.16, 1.12, 2.4), (43, 30), (107, 89, 79), (35, 39, 32)),
    ("Table 1", "ground truth", (1.33, 3.8, 2.9), (99, 5), (None, None, None), (None, None, None)),
    ("Table 1", "iPLAN", (None, None, 21.0), (67.8, 6), (None, None, 76), (None, None, 3)),
    ("Table 2", "SL", (0.17, 6.9, 14.0), (22, 16), (101, 17, 19), (12, 21, 19)),
    ("Table 2", "SL+RL", (0.38, 0.77, 1.6), (33, 28), (92, 60, 73), (12, 43, 29)),
    ("Table 2", "ground truth", (1.27, 2.96, 3.1), (100, 0), (None, None, None), (None, None, None)),
    ("Table 2", "iPLAN", (None, None, 21.0), (67.8, 6), (None, None, 76), (None, None, 3)),
)


def published_rows() -> list[dict[str, Any]]:
    """One row per table, method and type. `mean_speed_if_per_step_mps` is the speed as printed if that is per step."""
    recordings = dict(TABLES.values())
    rows = []
    for table, method, speed, success, survival, spread in _PRINTED:
        own = method.startswith("SL")
        for place, kind in enumerate(("pedestrian", "bicycle", "car")):
            printed = speed[place]
            if printed is None and survival[place] is None:
                continue
            car = kind == "car"
            rows.append(
                {
                    "table": table,
                    "recordings": recordings[table],
                    "method": method,
                    "type": kind,
                    "measured_elsewhere": True,
                    "paper_success_rate": success[0] / 100 if car else None,
                    "paper_success_rate_std": success[1] / 100 if car else None,
                    "paper_survival_steps": survival[place],
                    "paper_survival_steps_std": spread[place],
                    "mean_speed_printed_mps": printed,
                    "mean_speed_if_per_step_mps": None if printed is None or not own else round(printed / 0.4, 3),
                }
            )
    return rows
