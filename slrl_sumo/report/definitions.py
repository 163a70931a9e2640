"""Definitions of the quantities in a run's report, with units."""

from slrl_sumo.metrics.conflicts import PET_LIMIT
from slrl_sumo.metrics.encounters import DEFINITIONS as ENCOUNTERS
from slrl_sumo.metrics.encounters import TTC_LIMIT
from slrl_sumo.metrics.traffic.queues import QUEUE_CELL, QUEUE_SPEED, WAIT
from slrl_sumo.scene.types import STANDING_SPEED

DEFINITIONS: dict[str, tuple[str, str]] = {
    "learned": (
        "learned road user",
        "A road user that is moved by learned models; the others are SUMO's own, the background.",
    ),
    "decision": ("decision", "Every 0.4 s each learned road user chooses a mode; an agent-step is one such decision."),
    "count": ("count", "Road users that were learned at some time during the run."),
    "mean_speed": (
        "mean speed (m/s)",
        "Mean over all agent-steps, standing ones included: distance covered in the last 0.4 s over 0.4 s.",
    ),
    "standing": ("standing (%)", f"Share of agent-steps with a speed below {STANDING_SPEED:g} m/s."),
    "collision": ("collision", f"{ENCOUNTERS['collision']} At least one of the two is learned."),
    "near_miss": ("near miss", f"{ENCOUNTERS['near miss']} At least one of the two is learned."),
    "survival": (
        "survival (decisions)",
        "Decisions before the first collision, or all of them; mean over learned road users.",
    ),
    "success": (
        "success (%)",
        "Share of the learned road users that came to the end of their trip, of their takeover or of the run without a "
        "collision, without leaving their own surface by more than 1 m, and without being lost.",
    ),
    "off_surface": (
        "off surface (%)",
        "Share of agent-steps at whose end the centre was not on a surface of the type's own: road and crossings for "
        "cars, all surfaces for others.",
    ),
    "lost": (
        "lost, wrapped around, taken over, handed back, returned to route, arrived, under way",
        "Counts of road users. Lost: removed by SUMO before they arrived. Wrapped around: left the scene and were "
        "reinserted elsewhere. Taken over: became learned; handed back: became SUMO's again. Returned to route: had "
        "left their route or the network, were put on their route and handed back. Arrived: reached their destination "
        "while learned or after they were handed back. Under way: are or were learned, and are in the network at the "
        "end.",
    ),
    "real_time": (
        "times real time",
        "Simulated seconds per second of wall time; agent-steps per s: decisions of single road users per second.",
    ),
    "motion": (
        "speed (m/s), acceleration (m/s²), yaw rate (rad/s)",
        "Backward differences of positions, speeds and headings over 0.4 s; one value for each road user and 0.4 s, "
        "from its second moment on (acceleration: third). A bin that is far higher than the others is cut in the "
        "figures, with its height beside it: of the learned road users, then of the others.",
    ),
    "js": (
        "Jensen-Shannon distance",
        "Distance between two distributions: 0 where their histograms are the same, 1 where they do not overlap; no "
        "unit. The root of the Jensen-Shannon divergence to base 2 (Endres and Schindelin 2003). It depends "
        "on the bins, which are those of the figures, and on how different the situations were.",
    ),
    "realism": (
        "realism score",
        "After the Waymo Open Sim Agents Challenge (Montali et al. 2023), from 0 to 1: how likely what a road user of "
        "the reference did in 6.4 s is among what the learned road users that began most alike did, over its "
        "likelihood among the reference's own. Kinematic: speed, standing, acceleration, yaw rate and its change. "
        "Interactive: distance to the nearest box, overlaps, TTC. Map: distance to the edge of the own surface, and "
        "whether off it. Weighted geometric means. It measures how similar two kinds of traffic are and is not "
        "comparable with the challenge's scores.",
    ),
    "queue": (
        "queue",
        f"Vehicles and bicycles slower than {QUEUE_SPEED:g} m/s for at least {WAIT:g} s without a break, learned or "
        f"SUMO's own, in one square of {QUEUE_CELL:g} m; at signals, too. Its longest state counts those that stand at "
        "the same time; its waiting time adds up that of all. The lane is SUMO's, the one with most of it.",
    ),
    "ttc": (
        "time to collision, TTC (s)",
        "Time until the boxes of two road users would touch if both kept velocity and heading, in the plane, at any "
        f"angle (Hayward 1972). An encounter is a conflict where the smallest value is below {TTC_LIMIT:g} s; it "
        "counts once, and 0 is an overlap. Pairs of pedestrians are left out, and those that overlap from the first "
        "moment on.",
    ),
    "pet": (
        "post-encroachment time, PET (s)",
        "Time between the moment at which the first of two road users leaves a place and that at which the second "
        "reaches it, where their paths cross at 30° or more (Allen, Shin and Cooper 1978); in steps of 0.1 s. An "
        f"encounter is a conflict where it is below {PET_LIMIT:g} s; pairs of pedestrians are left out.",
    ),
    "road_user_hour": (
        "road-user hour (h)",
        "The time that all road users together, learned ones and SUMO's own, spent in the network.",
    ),
    "density": (
        "density (road users per 1000 m²)",
        "How many road users of all types were in a cell on average over the run, over the cell's area; learned ones "
        "and SUMO's own together. Cells without any road user are left blank.",
    ),
    "space_time": (
        "space-time diagram (m over s)",
        "A line for each road user within 5 m of the busiest path and along it. The busiest path is the longest one "
        "that a vehicle took between the two places (20 m squares) between which vehicles travelled most metres.",
    ),
    "mode": (
        "mode",
        "One of 20 clusters, by type, of the motion of recorded road users, in their own frame: of where they were "
        "after 4.8 s, or, for vehicles of the bundle intersection, of accelerations in the first 1.2 s as shares of "
        "what was recorded at that speed. The share is that of all decisions of the type. A dot marks the mean of a "
        "mode; its size is the share.",
    ),
    "ego_image": (
        "ego image",
        "The image that the selector gets: 40 m by 20 m, one pixel per metre, the road user at 0, 0 heading right. "
        "Road white, pavement yellow, cars red, cyclists blue, pedestrians green. With routes: crossings grey, cycle "
        "lanes cyan, the path ahead magenta.",
    ),
    "path": ("path", "Positions of the centres of learned road users, every 0.4 s."),
}
"""By name: title with unit, and text."""
