"""Learned road users over TraCI, in a sumo that runs as a process of its own (here: started on a free port).

python docs/examples/attach_traci.py path/to/your.sumocfg [seconds]
"""

import subprocess
import sys

import sumolib
import traci

import slrl_sumo


def main(config: str, seconds: float) -> None:
    """Connect to a sumo on a port, add eight learned road users, and close it in the end."""
    port = sumolib.miscutils.getFreeSocketPort()
    options = ["--step-length", "0.4", "--time-to-teleport", "-1", "--collision.action", "warn", "--no-step-log"]
    sumo = subprocess.Popen([sumolib.checkBinary("sumo"), "-c", config, "--remote-port", str(port), *options])
    connection = traci.connect(port)
    try:
        with slrl_sumo.attach(connection, agents=8) as learned:
            while connection.simulation.getTime() < seconds:
                world = learned.step()
        print(
            f"{connection.simulation.getTime():g} s: {int(world.learned.sum())} of {len(world)} road users were learned"
        )
    finally:
        connection.close()
        sumo.wait()


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else 60.0)
