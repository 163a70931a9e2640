"""The loop: learned road users and SUMO, one decision after the other."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.selector import Selector
from slrl_sumo.perception.observation import Observation, observe
from slrl_sumo.simulation.background import Differences, background_world, places_of
from slrl_sumo.simulation.events import Decision, Step
from slrl_sumo.simulation.looping import bring_back, left_scene
from slrl_sumo.simulation.spawn import draw_starts, starting_points
from slrl_sumo.sumo.placement import LEARNED_TYPES
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.world.advance import advance
from slrl_sumo.world.geometry import Floats, wrap_angle
from slrl_sumo.world.roadmap import RoadMap
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import DECISION_INTERVAL, DEFAULT_LENGTH, DEFAULT_WIDTH, TYPE_NAMES


class CoSimulation:
    """Learned road users in a running SumoSession.

    `counts`: road users to spawn per type, (3,), at legal places drawn by `seed`. Call `start` once, then `decide` for
    every 0.4 s. `learned` is their present state, `world` that of all road users; `surfaces` and `roadmap` are the
    ground.
    """

    def __init__(
        self, session: SumoSession, bundle: ModelBundle, selector: Selector, counts: NDArray[np.int64], seed: int
    ) -> None:
        self.surfaces = session.network.surfaces()
        self.roadmap = RoadMap(self.surfaces)
        self._session, self._bundle, self._selector = session, bundle, selector
        self._points = starting_points(session.network)
        self._differences = Differences()
        self.learned = self._spawn(counts, np.random.default_rng(seed))
        self.world = self.learned
        self._max_speed = bundle.max_speed[self.learned.type]
        self._sumo_types = tuple(LEARNED_TYPES[kind] for kind in self.learned.type)
        self._own_ids = frozenset(self.learned.ids)

    def _spawn(self, counts: NDArray[np.int64], rng: np.random.Generator) -> WorldState:
        kinds, x, y, heading, limit = draw_starts(counts, self._points, rng)
        n = len(kinds)
        numbers = np.concatenate([np.arange(c) for c in counts])
        # Everybody is under way already, between slow and usual for the type, and no faster than the lane allows.
        usual = np.minimum(0.5 * self._bundle.max_speed[kinds], limit)
        return WorldState(
            time=self._session.time,
            ids=tuple(f"learned_{TYPE_NAMES[kind]}.{number}" for kind, number in zip(kinds, numbers, strict=True)),
            type=kinds,
            x=x,
            y=y,
            heading=heading,
            speed=usual * rng.uniform(0.5, 1.0, n),
            acceleration=np.zeros(n),
            yaw_rate=np.zeros(n),
            length=DEFAULT_LENGTH[kinds],
            width=DEFAULT_WIDTH[kinds],
            learned=np.ones(n, np.bool_),
        )

    def start(self) -> Step:
        """Bring the learned road users into SUMO: one SUMO step, after which they stand at their starting places."""
        users = self.learned
        self._session.placement.add(users.ids, users.type, users.x, users.y)
        step, _ = self._play([users])
        return step[0]

    def decide(self) -> Decision:
        """One decision of every learned road user and the SUMO steps of its interval."""
        observation = self.observe(np.arange(len(self.learned)), self._selector.needs_image)
        modes = self._selector.choose(observation)
        acceleration, yaw_rate = self._bundle.motion(observation, modes)
        following = advance(self.learned, acceleration, yaw_rate, self._max_speed, DECISION_INTERVAL)
        looped = left_scene(following, self.roadmap)
        if looped.any():
            background = self.world.take(np.arange(len(self.learned), len(self.world)))
            following = bring_back(following, looped, background, self._points, self.roadmap)
        substeps = self._session.substeps
        states = [between(self.learned, following, k / substeps, looped) for k in range(1, substeps + 1)]
        steps, lost = self._play(states)
        surface = self.roadmap.surface_at(self.learned.x, self.learned.y)
        return Decision(steps, modes, surface, looped, lost)

    def observe(self, rows: NDArray[np.intp], with_image: bool) -> Observation:
        """What the learned road users `rows` see now."""
        return observe(self.world, rows, self.roadmap, with_image=with_image)

    def _play(self, states: list[WorldState]) -> tuple[tuple[Step, ...], NDArray[np.bool_]]:
        """Move the learned road users through `states`, one SUMO step each; at the end look who is still there."""
        steps = []
        for users in states:
            time = self._session.time
            self._session.placement.move(
                users.ids, users.type, users.x, users.y, users.heading, users.speed, users.length
            )
            self._session.step()
            snapshot = self._session.reader.read()
            background = background_world(snapshot, self._session.time, self._own_ids)
            places = places_of(users, self._sumo_types, background, snapshot)
            steps.append(Step(time, replace(users, time=time).join(background), places))
        self.learned = replace(users, time=self._session.time)
        self.world = self.learned.join(self._differences.complete(background))
        present = frozenset(snapshot.ids)
        lost = np.array([road_user not in present for road_user in users.ids], np.bool_)
        if lost.any():
            back = users.take(np.flatnonzero(lost))
            self._session.placement.remove(back.ids)
            self._session.placement.add(back.ids, back.type, back.x, back.y)
        return tuple(steps), lost


def between(a: WorldState, b: WorldState, share: float, jumped: NDArray[np.bool_]) -> WorldState:
    """Road users on their straight way from `a` to `b`, `share` in (0, 1]; those that `jumped` (n,) are at `b`."""

    def mix(p: Floats, q: Floats) -> Floats:
        return np.where(jumped, q, p + share * (q - p))

    turn = wrap_angle(b.heading - a.heading)
    return replace(
        b,
        x=mix(a.x, b.x),
        y=mix(a.y, b.y),
        heading=np.where(jumped, b.heading, wrap_angle(a.heading + share * turn)),
    )
