"""Who is learned at the moment: road users that we added, and road users of the scenario that are lent to us."""

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

    `world`: their present state, n road users; `lent`: which of them belong to the scenario, (n,); `sumo_types`: their
    vTypes; `ids`: their ids.
    """

    def __init__(self, placement: SpawnedControl, loans: TakenOverControl) -> None:
        self.world: WorldState = empty_world()
        self.lent: NDArray[np.bool_] = np.zeros(0, np.bool_)
        self.sumo_types: tuple[str, ...] = ()
        self.ids: frozenset[str] = frozenset()
        self._missed: set[str] = set()
        self._placement, self._loans = placement, loans

    def spawn(self, kinds: NDArray[np.int8], x: Floats, y: Floats, heading: Floats, speed: Floats, time: float) -> None:
        """Add road users of ours: RoadUserType, centres (m), headings (rad), speeds (m/s), all (n,)."""
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
        self._placement.add(users.ids, users.type, users.x, users.y)
        self._join(users, tuple(LEARNED_TYPES[kind] for kind in kinds), lent=False)

    def take_over(self, users: WorldState, sumo_types: tuple[str, ...]) -> None:
        """Borrow road users of the scenario; they start from the state that SUMO left them in."""
        self._loans.take_over(users.ids, users.type == RoadUserType.PEDESTRIAN)
        self._join(replace(users, learned=np.ones(len(users), np.bool_)), sumo_types, lent=True)

    def hand_back(self, leaving: NDArray[np.bool_], *, strayed: bool = False) -> tuple[str, ...]:
        """Give lent road users `leaving` (n,) back to SUMO. Returns the ids of those that SUMO could take at once.

        Those that `strayed` from the network are put on their route again, wherever that is.
        """
        rows = np.flatnonzero(leaving & self.lent)
        users = self.world.take(rows)
        done = self._loans.hand_back(users.ids, users.type == RoadUserType.PEDESTRIAN, off_route=strayed)
        back = tuple(i for i, gone in zip(users.ids, done.tolist(), strict=True) if gone)
        self.keep(~np.isin(np.arange(len(self.world)), rows[done]))
        return back

    def move(self, users: WorldState) -> None:
        """Tell SUMO where everybody is after its next step; `users` in the order of `world`."""
        for mask, movable in ((~self.lent, self._placement), (self.lent, self._loans)):
            rows = np.flatnonzero(mask)
            if not len(rows):
                continue
            u = users if len(rows) == len(users) else users.take(rows)
            if movable is self._loans and self._missed:
                # Gone since the interval began.
                u = u.take(np.array([i for i, user in enumerate(u.ids) if user not in self._missed], np.intp))
            if movable is self._placement:
                self._placement.move(u.ids, u.type, u.x, u.y, u.heading, u.speed, u.length)
            else:
                walking = u.type == RoadUserType.PEDESTRIAN
                self._loans.move(u.ids, walking, u.x, u.y, u.heading, u.speed, u.length)

    def check(self, users: WorldState, present: frozenset[str]) -> None:
        """After a SUMO step: see who of `users` is not among SUMO's `present` ids. Ours are added again at once."""
        if present.issuperset(users.ids):
            return
        missing = np.array([user not in present for user in users.ids], np.bool_)
        missing &= ~(self.lent & np.array([user in self._missed for user in users.ids], np.bool_))
        if not missing.any():
            return
        self._missed.update(users.ids[row] for row in np.flatnonzero(missing))
        self._loans.forget(users.take(np.flatnonzero(missing & self.lent)).ids)
        ours = users.take(np.flatnonzero(missing & ~self.lent))
        self._placement.remove(ours.ids)
        self._placement.add(ours.ids, ours.type, ours.x, ours.y)

    def settle(self, users: WorldState) -> NDArray[np.bool_]:
        """Take `users` as the new state, without the lent ones that have gone.

        Returns who was missing since the last call, (n,) in the order before.
        """
        missed = np.array([user in self._missed for user in users.ids], np.bool_)
        self.world = users
        self._missed.clear()
        self.keep(~(missed & self.lent))
        return missed

    def keep(self, mask: NDArray[np.bool_]) -> None:
        """Drop road users from the population (not from SUMO): those where `mask` (n,) is False."""
        if mask.all():
            return
        rows = np.flatnonzero(mask)
        self.world, self.lent = self.world.take(rows), self.lent[rows]
        self.sumo_types = tuple(self.sumo_types[row] for row in rows)
        self.ids = frozenset(self.world.ids)

    def _join(self, users: WorldState, sumo_types: tuple[str, ...], *, lent: bool) -> None:
        self.world = replace(self.world, time=users.time).join(users)
        self.lent = np.concatenate([self.lent, np.full(len(users), lent)])
        self.sumo_types += sumo_types
        self.ids = frozenset(self.world.ids)
