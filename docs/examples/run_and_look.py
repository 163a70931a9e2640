"""Run learned road users in a scenario and look at the results: python run_and_look.py SCENARIO FOLDER"""

import sys
from pathlib import Path

import slrl_sumo

scenario, folder = sys.argv[1], Path(sys.argv[2])

# SUMO runs in a process of its own: if it dies, this script gets an error and goes on.
result = slrl_sumo.run(scenario, agents=20, mix={"car": 0.5, "bicycle": 0.2, "pedestrian": 0.3}, steps=50, seed=1)
print(f"{result.summary.agent_steps} decisions, {result.summary.per_type['car'].mean_speed_mps:.1f} m/s by car")

# One row for each road user and 0.4 s.
tracks = result.trajectories.to_pandas()
print(tracks[tracks.learned].groupby("type", observed=True).speed_mps.describe().round(1))

print(result.report(folder / "report"))
print(result.replay(folder / "replay.html"))
