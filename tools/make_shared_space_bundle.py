"""The recipe of the shipped bundle `shared-space`: a real shared street (HC), then a supervised fit.

    python tools/make_shared_space_bundle.py PATH/TO/hc --out slrl_sumo/bundles/shared-space

PATH/TO/hc holds D1.csv, D2.csv, D3.csv and LICENSE.md (https://github.com/haohao11/MCENET, data/HC). Learned from D1,
measured on D2 and D3. Takes half a minute.
"""

import argparse
from pathlib import Path

from slrl_sumo.formats.importers.hc import read_hc
from slrl_sumo.learning.supervised.fit import fit


def main() -> None:
    """Read and fit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder with D1.csv, D2.csv, D3.csv and LICENSE.md")
    parser.add_argument("--out", type=Path, required=True, help="bundle folder to write")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    licence = (arguments.data / "LICENSE.md").read_text(encoding="utf-8").strip()
    train, *tests = (read_hc(arguments.data / f"D{number}.csv") for number in (1, 2, 3))
    notice = f"The data, of which these weights are a derived work, comes with this notice:\n\n{_quoted(licence)}"
    # Whole paths and the last 2 s predict better, but drive slower: pedestrians at 1.03 instead of 1.24 m/s.
    name, seed = arguments.out.name, arguments.seed
    bundle = fit([train], name=name, seed=seed, modes="relative", preset="paper", tests=tests, notice=notice)
    bundle.save(arguments.out)
    print((arguments.out / "MODEL_CARD.md").read_text(encoding="utf-8"))


def _quoted(text: str) -> str:
    return "\n".join(f"> {line}".rstrip() for line in text.splitlines())


if __name__ == "__main__":
    main()
