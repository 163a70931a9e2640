"""Jobs of the studies in processes of their own."""

import subprocess
import sys

import pytest

JOBS = {
    "compare": """
from slrl_sumo.studies.compare.run import LEARNED, ComparedScenario, Run, run_comparison
record = run_comparison(ComparedScenario("intersection", "intersection", decisions=5), Run(1, LEARNED))
print(record["learned"]["steps"] > 0, end=" ")
""",
    "evaluate": """
from slrl_sumo.studies.episodes.episode import Episode, EpisodeSettings, run_episode
print(len(run_episode(EpisodeSettings("intersection", "intersection", 5), Episode("greedy", 8, 1, 0))) > 0, end=" ")
""",
    "flow": """
from slrl_sumo.studies.flow.run import Run, run_case
print(len(run_case("intersection", 1.0, Run("bends", "greedy", 1))["trips"]) > 0, end=" ")
""",
}


@pytest.mark.parametrize("job", JOBS.values(), ids=JOBS)
def test_learned_road_users_are_driven_without_pytorch(job: str) -> None:
    """Its import is more than half of the start of a process: 1.2 of 2.0 s."""
    code = f"{job}\nimport sys\nprint('torch' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert result.stdout.split() == ["True", "False"]
