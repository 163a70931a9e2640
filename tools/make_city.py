"""A city of right-angled streets, for measurements of start-up and memory in large networks.

    python tools/make_city.py OUT [--blocks 50] [--block 200]

Writes OUT/city.net.xml and OUT/city.sumocfg (steps of 0.4 s): BLOCKS x BLOCKS blocks of BLOCK m, streets with walks,
junctions with crossings. 50 blocks of 200 m are 10 km x 10 km; 15 blocks make a net of about 3 MB.
"""

import argparse
from pathlib import Path

from slrl_sumo.netgen.binaries import run_program

CONFIG = """<configuration>
    <input><net-file value="city.net.xml"/></input>
    <time><begin value="0"/><step-length value="0.4"/></time>
</configuration>
"""


def main() -> None:
    """Draw the net and write its configuration."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--blocks", type=int, default=50)
    parser.add_argument("--block", type=float, default=200.0, help="m")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    options = ["--grid", "--grid.number", str(arguments.blocks + 1), "--grid.length", f"{arguments.block:g}"]
    options += ["--sidewalks.guess", "--sidewalks.guess.max-speed", "20", "--crossings.guess", "--no-turnarounds"]
    run_program("netgenerate", [*options, "--output-file", "city.net.xml"], arguments.out)
    (arguments.out / "city.sumocfg").write_text(CONFIG)
    size = (arguments.out / "city.net.xml").stat().st_size
    print(f"{arguments.out / 'city.sumocfg'}: {size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
