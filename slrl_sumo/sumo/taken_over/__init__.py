"""Road users of the scenario that are taken over, moved from outside, and handed back to SUMO.

Rules (measured with libsumo 1.28, see docs/explanation/sumo.md):

- Vehicles move with keepRoute 3, so that their route survives, with speed mode 16 and lane change mode 0. Both are
  restored on hand-back (otherwise SUMO ignores all obstacles), and `setSpeed(-1)` lets SUMO choose the speed again.
- A vehicle that is moved past a stop loses it silently: vehicles with stops ahead are left to SUMO.
- Vehicles with stops ahead, also with ones that a script or a taxi dispatch adds later, are handed back, and so are
  persons that begin another stage: SUMO refuses to move a person that rides or is in an <access> stage.
- Vehicles with a calibrator or vaporizer on their next edge are handed back, see `removing_edges`.
- A person on the way to a stop that it reaches by <access>, also one on the edge of the stop, is left to SUMO: if its
  walk is changed, SUMO begins the access at once, wherever it is.
- A walk over many edges ends in "Disconnected walk" or a crash when the person is moved. While a person is taken over,
  its walk is the one edge under it; on hand-back it gets the rest of its walk, and keeps its later stages.
"""

from slrl_sumo.sumo.taken_over.control import TakenOverControl

__all__ = ["TakenOverControl"]
