"""Reference for the learned road users of a run, and conflicts between the two groups."""

from dataclasses import dataclass

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.metrics.conflicts import Conflicts
from slrl_sumo.metrics.distributions import Kinematics, kinematics
from slrl_sumo.metrics.realism import Realism, realism
from slrl_sumo.report.recorder import RunRecord
from slrl_sumo.scene.types import TYPE_NAMES


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference road users for the comparison with the learned road users of a run."""

    name: str
    motion: Kinematics
    realism: dict[str, Realism]
    """Of the learned ones, by type name; empty where the two groups have no type in common."""


def reference_for(record: RunRecord, recording: Trajectories | None) -> Reference:
    """The road users of a recording; without a recording, the background road users of the same run.

    A recording comes from another place: map features are left out.
    """
    tracks, learned = record.tracks, record.tracks.learned
    if recording is not None:
        scores = realism(simulated=tracks, reference=recording, tracks=learned)
        return Reference(recording.source or "the recording", kinematics(recording), scores)
    shapes = record.started.surfaces
    scores = realism(simulated=tracks, reference=tracks, tracks=learned, reference_tracks=~learned, shapes=shapes)
    return Reference("SUMO's own in this run", kinematics(tracks, ~learned), scores)


def counts_by_group(found: Conflicts, tracks: Trajectories) -> dict[tuple[str, str], dict[str, int]]:
    """Encounters by pair of types, and between `learned`, `mixed` and `background`; pairs without any are left out."""
    counts: dict[tuple[str, str], dict[str, int]] = {}
    for a, b in zip(found.a.tolist(), found.b.tolist(), strict=True):
        first, second = sorted((int(tracks.type[a]), int(tracks.type[b])))
        pair = TYPE_NAMES[first], TYPE_NAMES[second]
        group = ("background", "mixed", "learned")[int(tracks.learned[a]) + int(tracks.learned[b])]
        counts.setdefault(pair, dict.fromkeys(("learned", "mixed", "background"), 0))[group] += 1
    return dict(sorted(counts.items()))
