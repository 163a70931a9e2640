"""Takeover of road users of the scenario: they are moved from outside, and handed back to SUMO.

Rules (measured with libsumo 1.28, see docs/explanation/sumo.md):

- Vehicles move with keepRoute 3, so that their route survives, with speed mode 16 and lane change mode 0. Both are
  restored on hand-back (otherwise SUMO ignores all obstacles), and `setSpeed(-1)` lets SUMO choose the speed again.
- A vehicle that is moved past a stop silently loses the stop: vehicles with stops ahead are not taken over.
- Vehicles with stops ahead, including stops that a script or a taxi dispatch adds later, are handed back, and so are
  persons that begin another stage: SUMO refuses to move a person that rides or is in an <access> stage.
- Vehicles with a calibrator or vaporizer on their next edge are handed back, see `removing_edges`.
- A person on the way to a stop with <access>, also on the edge of the stop, is not taken over: if its walk is changed,
  SUMO begins the access immediately, at any position.
- A walk over many edges ends in "Disconnected walk" or a crash when the person is moved. During the takeover, the walk
  of a person is the edge under it; on hand-back it gets the rest of its walk, and keeps its later stages.
"""

from slrl_sumo.sumo.taken_over.control import TakenOverControl

__all__ = ["TakenOverControl"]
