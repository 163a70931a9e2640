"""The learned road users of a simulation: spawned road users, and road users taken over from the scenario."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import count

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState, empty_world
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH, PEDESTRIAN
from slrl_sumo.sumo.spawned import LEARNED_TYPES, SpawnedControl
from slrl_sumo.sumo.taken_over import TakenOverControl


class Population:
    """The learned road users of a simulation, in SUMO and as a WorldState.

    `world`: present state of the n road users. `taken_over`: whether each one belongs to the scenario, (n,).
    `sumo_types`: their vTypes. `ids`: their ids. `spawned_ids`: ids of the spawned ones.
    """

    def __init__(self, spawned: SpawnedControl, taken_over: TakenOverControl) -> None:
        self.world: WorldState = empty_world()
        self.taken_over: NDArray[np.bool_] = np.zeros(0, np.bool_)
        self.sumo_types: tuple[str, ...] = ()
        self.ids: frozenset[str] = frozenset()
        self.spawned_ids: frozenset[str] = frozenset()
        self._missed: set[str] = set()
        self._dropped: set[str] = set()
        self._spawned_control, self._taken_over_control = spawned, taken_over

    def spawn(self, kinds: NDArray[np.int8], x: Floats, y: Floats, heading: Floats, speed: Floats, time: float) -> None:
        """Add road users: RoadUserType, centres (m), headings (rad), speeds (m/s), all (n,)."""
        n = len(kinds)
        present = self._spawned_control.loaded()
        free = [_free_ids(name, present) for name in LEARNED_TYPES]
        users = WorldState(
            time=time,
            # A user's script may already have road users with such ids.
            ids=tuple(next(free[kind]) for kind in kinds.tolist()),
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
        """Control road users of the scenario from now on, starting from their states in SUMO."""
        given = self._taken_over_control.take_over(users.ids, users.type == PEDESTRIAN)
        rows = np.flatnonzero(given)
        users = replace(users.take(rows), learned=np.ones(len(rows), np.bool_))
        self._join(users, tuple(sumo_types[row] for row in rows), taken_over=True)

    def unsupported(self) -> NDArray[np.bool_]:
        """Whether each road user must go back to SUMO, because it makes a planned stop or no longer walks, (n,)."""
        must = np.zeros(len(self.world), np.bool_)
        rows = np.flatnonzero(self.taken_over)
        users = self.world.take(rows)
        must[rows] = self._taken_over_control.unsupported(users.ids, users.type == PEDESTRIAN)
        return must

    def hand_back(self, leaving: NDArray[np.bool_], *, off_route: bool = False) -> tuple[str, ...]:
        """Hand the road users `leaving` (n,) of the scenario back to SUMO; return the ids that SUMO accepted.

        With `off_route`, SUMO puts them back on their route, at any distance.
        """
        rows = np.flatnonzero(leaving & self.taken_over)
        if not len(rows):
            return ()
        users = self.world.take(rows)
        done = self._taken_over_control.hand_back(users.ids, users.type == PEDESTRIAN, off_route=off_route)
        back = tuple(i for i, gone in zip(users.ids, done.tolist(), strict=True) if gone)
        self.keep(~np.isin(np.arange(len(self.world)), rows[done]))
        return back

    def move(self, users: WorldState) -> None:
        """Set the states of the learned road users after SUMO's next step; call it directly before that step.

        `users`: in the order of `world`.
        """
        self._taken_over_control.place_handed_back()
        for mask, control in ((~self.taken_over, self._spawned_control), (self.taken_over, self._taken_over_control)):
            rows = np.flatnonzero(mask)
            if not len(rows):
                continue
            u = users if len(rows) == len(users) else users.take(rows)
            if self._dropped:
                u = u.take(np.array([i for i, user in enumerate(u.ids) if user not in self._dropped], np.intp))
            if control is self._spawned_control:
                self._spawned_control.move(u.ids, u.type, u.x, u.y, u.heading, u.speed, u.length)
            else:
                walking = u.type == PEDESTRIAN
                self._taken_over_control.move(u.ids, walking, u.x, u.y, u.heading, u.speed, u.length)

    def check(self, users: WorldState, present: frozenset[str]) -> None:
        """After a SUMO step, detect `users` that are not among SUMO's `present` ids; add spawned road users again."""
        if present.issuperset(users.ids):
            return
        missing = np.array([user not in present and user not in self._dropped for user in users.ids], np.bool_)
        if not missing.any():
            return
        self._missed.update(users.ids[row] for row in np.flatnonzero(missing))
        self.drop(users.take(np.flatnonzero(missing & self.taken_over)).ids)
        spawned = users.take(np.flatnonzero(missing & ~self.taken_over))
        self._spawned_control.remove(spawned.ids)
        self._spawned_control.add(spawned.ids, spawned.type, spawned.x, spawned.y)

    def drop(self, ids: Iterable[str]) -> None:
        """Stop moving road users: SUMO drives road users of the scenario again, and spawned road users are removed.

        They stay in `world` until `settle`.
        """
        dropped = self.ids.intersection(ids)
        self._dropped |= dropped
        self._taken_over_control.abandon(dropped)
        self._spawned_control.remove(tuple(dropped))

    def settle(self, users: WorldState) -> NDArray[np.bool_]:
        """Set `users` as the new state, without road users that were dropped or that SUMO has removed.

        Returns whether SUMO has removed each road user since the last call, (n,) in the previous order. Spawned road
        users are kept, because they were added again.
        """
        missed = np.array([user in self._missed for user in users.ids], np.bool_)
        dropped = np.array([user in self._dropped for user in users.ids], np.bool_)
        self.world = users
        self._missed.clear()
        self._dropped.clear()
        self.keep(~dropped)
        return missed

    def resume(self, present: WorldState) -> tuple[str, ...]:
        """Continue from the states in `present`, all road users of SUMO, after the caller has stepped SUMO.

        Road users of the scenario that are missing in `present` are dropped; the method returns their ids. Spawned road
        users are added again.
        """
        places = {road_user: row for row, road_user in enumerate(present.ids)}
        rows = np.array([places.get(road_user, -1) for road_user in self.world.ids], np.intp)
        there, users = rows >= 0, self.world
        if there.any():
            now = present.take(np.maximum(rows, 0))
            users = replace(
                users,
                x=np.where(there, now.x, users.x),
                y=np.where(there, now.y, users.y),
                heading=np.where(there, now.heading, users.heading),
                speed=np.where(there, now.speed, users.speed),
            )
        zero = np.zeros(len(users))
        users = replace(users, time=present.time, acceleration=zero, yaw_rate=zero)
        before = self.ids
        self.check(users, frozenset(present.ids))
        self.settle(users)
        return tuple(before - self.ids)

    def keep(self, mask: NDArray[np.bool_]) -> None:
        """Drop the road users for which `mask` (n,) is False from the population, not from SUMO."""
        if mask.all():
            return
        rows = np.flatnonzero(mask)
        self.world, self.taken_over = self.world.take(rows), self.taken_over[rows]
        self.sumo_types = tuple(self.sumo_types[row] for row in rows)
        self._update_ids()

    def _join(self, users: WorldState, sumo_types: tuple[str, ...], *, taken_over: bool) -> None:
        self.world = replace(self.world, time=users.time).join(users)
        self.taken_over = np.concatenate([self.taken_over, np.full(len(users), taken_over)])
        self.sumo_types += sumo_types
        self._update_ids()

    def _update_ids(self) -> None:
        rows = zip(self.world.ids, self.taken_over.tolist(), strict=True)
        self.ids, self.spawned_ids = frozenset(self.world.ids), frozenset(user for user, taken in rows if not taken)


def _free_ids(sumo_type: str, present: frozenset[str]) -> Iterator[str]:
    """New ids of road users of a type: its name with numbers from 0 on, without the ids in `present`."""
    return (road_user for number in count() if (road_user := f"{sumo_type}.{number}") not in present)
