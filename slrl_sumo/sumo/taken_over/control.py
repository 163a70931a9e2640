"""Takes road users of the scenario over, moves them, and hands them back to SUMO (rules: see the package)."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats, front_from_centre, heading_to_sumo
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.refusals import Refusals
from slrl_sumo.sumo.road_users import loaded_ids, needed_deceleration
from slrl_sumo.sumo.taken_over.persons import TakenOverPersons
from slrl_sumo.sumo.taken_over.vehicles import TakenOverVehicles

REFUSED = "refused"
"""Reason why a road user cannot be taken over, in addition to the reasons of its control: SUMO refuses a call."""


class TakenOverControl:
    """Takes road users of the scenario over, moves them, and hands them back to SUMO.

    `refusals`: road users for which SUMO has refused a call. They remain taken over until `abandon`.
    """

    def __init__(self, api: SumoApi, network: Network) -> None:
        self.refusals = Refusals()
        self._api, self._network = api, network
        self._vehicles = TakenOverVehicles(api, network, self.refusals)
        self._persons = TakenOverPersons(api, network, self.refusals)

    @property
    def ids(self) -> frozenset[str]:
        """Ids of all road users that are presently taken over."""
        return self._vehicles.ids | self._persons.ids

    def obstacles(self, ids: Sequence[str], person: NDArray[np.bool_], *, models: bool) -> tuple[str, ...]:
        """Reasons why n road users on the network cannot be taken over, '' if they can; `person`: whether each one is a
        person, (n,).

        Eligible are walking persons, and vehicles on a lane without stops ahead, except trains, ships, aircraft and
        classes that crossings admit. With `models`, only vehicles that learned models suit are eligible.
        """
        found = []
        for road_user, walks in zip(ids, person.tolist(), strict=True):
            reason = REFUSED
            with self.refusals.of(road_user):
                reason = self._persons.obstacle(road_user) if walks else self._vehicles.obstacle(road_user, models)
            found.append(reason)
        return tuple(found)

    def needed_deceleration(self, ids: Sequence[str], person: NDArray[np.bool_], time: float) -> Floats:
        """Deceleration (m/s²) that each of n road users needs from `time` (s) on, see the function of this name, (n,);
        0 for persons."""
        needed = np.zeros(len(ids))
        for i in np.flatnonzero(~person).tolist():
            with self.refusals.of(ids[i]):
                needed[i] = needed_deceleration(self._api, ids[i], time)
        return needed

    def unsupported(self, ids: Sequence[str], person: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether each of n taken-over road users must be handed back, (n,).

        This concerns vehicles with a stop, a calibrator or a vaporizer ahead, and persons that no longer walk.
        """
        return self._each(ids, person, self._vehicles.is_interrupted, self._persons.does_not_walk)

    def take_over(self, ids: Sequence[str], person: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Take over n eligible road users; return whether each takeover succeeded, (n,).

        The caller must move them in each SUMO step from now on.
        """
        return self._each(ids, person, self._vehicles.take_over, self._persons.take_over)

    def move(
        self,
        ids: Sequence[str],
        person: NDArray[np.bool_],
        x: Floats,
        y: Floats,
        heading: Floats,
        speed: Floats,
        length: Floats,
    ) -> None:
        """Set the state of n road users after the next SUMO step: centres (m), headings (rad), speeds (m/s), (n,)."""
        front_x, front_y = (a.tolist() for a in front_from_centre(x, y, heading, length))
        angles, speeds = heading_to_sumo(heading).tolist(), speed.tolist()
        lanes_under = iter(self._network.walks.lanes_under(x[person], y[person]).tolist())
        for i, (road_user, walks) in enumerate(zip(ids, person.tolist(), strict=True)):
            with self.refusals.of(road_user):
                if walks:
                    self._persons.move(road_user, next(lanes_under), front_x[i], front_y[i], angles[i])
                else:
                    self._vehicles.move(road_user, front_x[i], front_y[i], angles[i], speeds[i])

    def place_handed_back(self) -> None:
        """Let the next SUMO step place the road users that were handed back since the last step.

        Vehicles on no lane are put on their route, vehicles beside the middle of their lane into the middle, and
        persons stay at their position. Call it directly before the step: a pending move is carried out in the next
        simulation of this process, if that has a road user of the same id, and sometimes crashes libsumo 1.28.
        """
        self._vehicles.put_on_route()
        self._vehicles.move_to_middle()
        self._persons.keep_in_place()

    def hand_back(self, ids: Sequence[str], person: NDArray[np.bool_], *, off_route: bool = False) -> NDArray[np.bool_]:
        """Hand n road users back to SUMO, (n,): False for a road user that remains taken over and must be moved on.

        That is a vehicle that SUMO has on no lane or inside a junction, and a person off all edges, such as on a
        crossing. `off_route`: vehicles on no lane are put on the nearest place of their route, at any distance.
        """
        return self._each(
            ids,
            person,
            lambda road_user: self._vehicles.hand_back(road_user, off_route),
            lambda road_user: self._persons.hand_back(road_user, off_route),
        )

    def abandon(self, ids: Iterable[str]) -> None:
        """Return road users to SUMO at their present positions, as far as SUMO allows.

        This is for road users that have left, that teleport, or for which SUMO has refused a call.
        """
        present, given_up = loaded_ids(self._api), frozenset(ids)
        for road_user in self._vehicles.ids & given_up:
            self._vehicles.abandon(road_user, present)
        for road_user in self._persons.ids & given_up:
            self._persons.abandon(road_user, present)

    def release(self) -> tuple[str, ...]:
        """Hand all road users back immediately, if possible; return the ids of the remaining road users.

        Persons go to the right side of their edge, also from a crossing or from beside the edge, where SUMO ends some
        walks: moving persons in the last step of a simulation crashes the next simulation. Vehicles on no lane are put
        on the nearest place of their route, at any distance: beside it, SUMO would lose them. A step must follow.
        """
        self.abandon(self.ids - loaded_ids(self._api))
        held, on_foot = sorted(self.ids), self._persons.ids
        persons = np.array([road_user in on_foot for road_user in held], np.bool_)
        back = self.hand_back(held, persons, off_route=True)
        self._vehicles.put_on_route()
        return tuple(road_user for road_user, given in zip(held, back.tolist(), strict=True) if not given)

    def _each(
        self,
        ids: Sequence[str],
        person: NDArray[np.bool_],
        of_vehicle: Callable[[str], bool],
        of_person: Callable[[str], bool],
    ) -> NDArray[np.bool_]:
        """Results of the functions for n road users, (n,); False if SUMO refuses a call."""
        said = np.zeros(len(ids), np.bool_)
        for i, (road_user, walks) in enumerate(zip(ids, person.tolist(), strict=True)):
            with self.refusals.of(road_user):
                said[i] = of_person(road_user) if walks else of_vehicle(road_user)
        return said
