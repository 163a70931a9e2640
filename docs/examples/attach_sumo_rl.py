"""Signals by sumo-rl, road users by this package, in one simulation.

pip install sumo-rl; python docs/examples/attach_sumo_rl.py path/to/your.net.xml path/to/your.rou.xml [seconds]
"""

import os
import sys

import sumo

import slrl_sumo

os.environ.setdefault("SUMO_HOME", sumo.SUMO_HOME)  # sumo-rl asks for it
from sumo_rl import SumoEnvironment

STEPS = 5
"""Of 0.2 s: sumo-rl counts its times in seconds and takes each of its steps for one."""


def main(net: str, routes: str, seconds: int) -> None:
    """One episode of sumo-rl's environment with one signal, by random actions; put your agent in their place."""
    env = SumoEnvironment(
        net_file=net,
        route_file=routes,
        single_agent=True,
        num_seconds=seconds,
        additional_sumo_cmd="--step-length 0.2 --collision.action warn --no-step-log",
        sumo_warnings=False,
    )
    env.reset()
    most, earned, done = 0, 0.0, False
    with slrl_sumo.attach(env.sumo, takeover={"car": 1, "bicycle": 1, "pedestrian": 1}) as learned:

        def second() -> None:
            nonlocal most
            for _ in range(STEPS):
                world = learned.step()
            most = max(most, int(world.learned.sum()))

        env._sumo_step = second
        decisions = 0
        while not done:
            _, reward, _, done, _ = env.step(env.action_space.sample())
            decisions, earned = decisions + 1, earned + reward
    print(f"{decisions} decisions of the signal earned {earned:.2f}; at most {most} road users were learned at once")
    env.close()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 120)
