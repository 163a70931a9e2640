"""Learned road users in a libsumo script of your own.

python docs/examples/attach_libsumo.py path/to/your.sumocfg [seconds]
"""

import sys

import libsumo

import slrl_sumo


def main(config: str, seconds: float) -> None:
    """Run a scenario; a third of its cars and all its pedestrians are learned."""
    libsumo.start(
        ["sumo", "-c", config, "--step-length", "0.4", "--time-to-teleport", "-1", "--collision.action", "warn"]
    )
    try:
        with slrl_sumo.attach(libsumo, takeover="car=0.33,pedestrian=1") as learned:
            while libsumo.simulation.getTime() < seconds:
                world = learned.step()
        print(f"{libsumo.simulation.getTime():g} s: {int(world.learned.sum())} of {len(world)} road users were learned")
        libsumo.simulationStep()  # from here on all road users are SUMO's again
    finally:
        libsumo.close()


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else 60.0)
