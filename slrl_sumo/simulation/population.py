"""The learned road users of a simulation: spawned ones, and ones that are taken over from the scenario."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState, empty_world
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH, TYPE_NAMES, RoadUserType
from slrl_sumo.sumo.spawned import LEARNED_TYPES, SpawnedControl
from slrl_sumo.sumo.taken_over import TakenOverControl


class Population:
    """The learned road users of a simulation, in SUMO and as a WorldState.

    `world`: their present state, n road users; `taken_over`: which of them belong to the scenario, (n,); `sumo_types`:
    their vTypes; `ids`: their ids.
    """

    def __init__(self, spawned: SpawnedControl, taken_over: TakenOverControl) -> None:
        self.world: WorldState = empty_world()
        self.taken_over: NDArray[np.bool_] = np.zeros(0, np.bool_)
        self.sumo_types: tuple[str, ...] = ()
        self.ids: frozenset[str] = frozenset()
        self._missed: set[str] = set()
        self._spawned_control, self._taken_over_control = spawned, taken_over

    @property
    def spawned_ids(self) -> frozenset[str]:
        """Ids of the spawned ones."""
        return frozenset(
            user for user, taken in zip(self.world.ids, self.taken_over.tolist(), strict=True) if not taken
        )

    def spawn(self, kinds: NDArray[np.int8], x: Floats, y: Floats, heading: Floats, speed: Floats, time: float) -> None:
        """Add road users: RoadUserType, centres (m), headings (rad), speeds (m/s), all (n,)."""
        n = len(kinds)
        numbers = [int((kinds[:i] == kinds[i]).sum()) for i in range(n)]
        users = WorldState(
            time=time,
            ids=tuple(f"learned_{TYPE_NAMES[kind]}.{number}" for kind, number in zip(kinds, numbers, strict=True)),
            type=kinds,
            x=x,
            y=y,
            heading=heading,
            speed=speed,
            acceleration=np.zeros(n),
            yaw_rate=np.zeros(n),
            length=DEFAULT_LENGTH[kinds],
            width=DEFAULT_WIDTH[kinds],
            learned=np.ones(n, np.bool_),
        )
        self._spawned_control.add(users.ids, users.type, users.x, users.y)
        self._join(users, tuple(LEARNED_TYPES[kind] for kind in kinds), taken_over=False)

    def take_over(self, users: WorldState, sumo_types: tuple[str, ...]) -> None:
        """Control road users of the scenario from now on; they start from the state that SUMO left them in."""
        self._taken_over_control.take_over(users.ids, users.type == RoadUserType.PEDESTRIAN)
        self._join(replace(users, learned=np.ones(len(users), np.bool_)), sumo_types, taken_over=True)

    def hand_back(self, leaving: NDArray[np.bool_], *, off_route: bool = False) -> tuple[str, ...]:
        """Hand road users `leaving` (n,) of the scenario back to SUMO. Returns the ids of those that SUMO could take.

        With `off_route` they are put on their route again, wherever that is.
        """
        rows = np.flatnonzero(leaving & self.taken_over)
        users = self.world.take(rows)
        done = self._taken_over_control.hand_back(users.ids, users.type == RoadUserType.PEDESTRIAN, off_route=off_route)
        back = tuple(i for i, gone in zip(users.ids, done.tolist(), strict=True) if gone)
        self.keep(~np.isin(np.arange(len(self.world)), rows[done]))
        return back

    def move(self, users: WorldState) -> None:
        """Set where the learned road users are after SUMO's next step; `users` in the order of `world`."""
        for mask, control in ((~self.taken_over, self._spawned_control), (self.taken_over, self._taken_over_control)):
            rows = np.flatnonzero(mask)
            if not len(rows):
                continue
            u = users if len(rows) == len(users) else users.take(rows)
            if control is self._taken_over_control and self._missed:
                # Gone since the interval began.
                u = u.take(np.array([i for i, user in enumerate(u.ids) if user not in self._missed], np.intp))
            if control is self._spawned_control:
                self._spawned_control.move(u.ids, u.type, u.x, u.y, u.heading, u.speed, u.length)
            else:
                walking = u.type == RoadUserType.PEDESTRIAN
                self._taken_over_control.move(u.ids, walking, u.x, u.y, u.heading, u.speed, u.length)

    def check(self, users: WorldState, present: frozenset[str]) -> None:
        """After a SUMO step: detect which `users` are not among SUMO's `present` ids; spawned ones are added again."""
        if present.issuperset(users.ids):
            return
        missing = np.array([user not in present for user in users.ids], np.bool_)
        missing &= ~(self.taken_over & np.array([user in self._missed for user in users.ids], np.bool_))
        if not missing.any():
            return
        self._missed.update(users.ids[row] for row in np.flatnonzero(missing))
        self._taken_over_control.forget(users.take(np.flatnonzero(missing & self.taken_over)).ids)
        spawned = users.take(np.flatnonzero(missing & ~self.taken_over))
        self._spawned_control.remove(spawned.ids)
        self._spawned_control.add(spawned.ids, spawned.type, spawned.x, spawned.y)

    def settle(self, users: WorldState) -> NDArray[np.bool_]:
        """Set `users` as the new state, without taken-over road users that SUMO has removed.

        Returns which ones were missing since the last call, (n,) in the order before.
        """
        missed = np.array([user in self._missed for user in users.ids], np.bool_)
        self.world = users
        self._missed.clear()
        self.keep(~(missed & self.taken_over))
        return missed

    def keep(self, mask: NDArray[np.bool_]) -> None:
        """Drop road users from the population (not from SUMO): those where `mask` (n,) is False."""
        if mask.all():
            return
        rows = np.flatnonzero(mask)
        self.world, self.taken_over = self.world.take(rows), self.taken_over[rows]
        self.sumo_types = tuple(self.sumo_types[row] for row in rows)
        self.ids = frozenset(self.world.ids)

    def _join(self, users: WorldState, sumo_types: tuple[str, ...], *, taken_over: bool) -> None:
        self.world = replace(self.world, time=users.time).join(users)
        self.taken_over = np.concatenate([self.taken_over, np.full(len(users), taken_over)])
        self.sumo_types += sumo_types
        self.ids = frozenset(self.world.ids)
