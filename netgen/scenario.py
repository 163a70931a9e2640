"""Scenarios: a net, its demand and a .sumocfg that plain `sumo -c` runs, written all or not at all."""

import os
import re
import shutil
from collections.abc import Mapping
from pathlib import Path

from lxml import etree

from slrl_sumo.netgen.demand import demand_xml
from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.netgen.network import build_net
from slrl_sumo.netgen.reach import read_graph
from slrl_sumo.netgen.specs import DemandSpec, NetSpec

STEP_LENGTH = 0.4
"""s: the decision interval of the learned road users (paper, section 3.2)."""


def write_scenario(spec: NetSpec, demand: DemandSpec, folder: Path, command: str | None = None) -> Path:
    """Make a scenario in `folder`: NAME.net.xml, NAME.rou.xml, NAME.sumocfg and README.md, NAME from the folder's name.

    The same spec and demand give the same bytes (with the same version of SUMO). The README names `command` as the way
    to generate the files; without it, the README shows the call of this function. Files of those names are replaced,
    others are left alone; where anything fails, nothing is written. Returns the path of the .sumocfg. Raises
    NetgenError: SUMO's programs missing or failing, a class of road users with nowhere to go, an unwritable folder."""
    # SUMO splits lists of file names at commas and trims blanks, so the files' names have neither.
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", folder.resolve().name).strip("-") or "scenario"
    _place(scenario_files(spec, demand, name, command), folder)
    return folder / f"{name}.sumocfg"


def scenario_files(spec: NetSpec, demand: DemandSpec, name: str, command: str | None = None) -> dict[str, bytes]:
    """The contents of the files of a scenario called `name`, by file name."""
    net = build_net(spec)
    return {
        f"{name}.net.xml": net,
        f"{name}.rou.xml": demand_xml(read_graph(net), demand),
        f"{name}.sumocfg": _sumocfg(name, demand),
        "README.md": _readme(name, spec, demand, command).encode(),
    }


def _sumocfg(name: str, demand: DemandSpec) -> bytes:
    sections: Mapping[str, Mapping[str, str]] = {
        "input": {"net-file": f"{name}.net.xml", "route-files": f"{name}.rou.xml"},
        "time": {"begin": "0", "end": f"{demand.duration:g}", "step-length": f"{STEP_LENGTH:g}"},
        # A road user that is moved from outside may stand; SUMO must not teleport or remove it.
        "processing": {"time-to-teleport": "-1", "collision.action": "warn", "pedestrian.model": "striping"},
        "report": {"no-step-log": "true"},
        "random_number": {"seed": str(demand.seed)},
    }
    root = etree.Element("configuration")
    for section, options in sections.items():
        parent = etree.SubElement(root, section)
        for option, value in options.items():
            etree.SubElement(parent, option, {"value": value})
    return etree.tostring(root, pretty_print=True, xml_declaration=True, encoding="UTF-8")


def _readme(name: str, spec: NetSpec, demand: DemandSpec, command: str | None) -> str:
    kind = type(spec).__name__
    summary = (type(spec).__doc__ or kind).splitlines()[0]
    call = f"write_scenario(\n    {spec!r},\n    {demand!r},\n    Path({name!r}),\n)"
    script = "```python\nfrom pathlib import Path\n\nfrom slrl_sumo.netgen.scenario import write_scenario\n"
    script += f"from slrl_sumo.netgen.specs import DemandSpec, {kind}\n\n{call}\n```"
    again = f"`{command}` generates it by this call:" if command else "This call generates it:"
    return f"""# {name}

{summary}

- `{name}.net.xml`: the road network.
- `{name}.rou.xml`: per hour {demand.cars_per_hour:g} cars, {demand.bicycles_per_hour:g} bicycles and \
{demand.pedestrians_per_hour:g} pedestrians, of types with different driving, riding and walking parameters.
- `{name}.sumocfg`: {demand.duration:g} s in steps of {STEP_LENGTH:g} s. Run it with `sumo -c {name}.sumocfg`.

{again}

{script}

The content may be used under the licence of slrl_sumo; it contains no recorded data.
"""


def _place(files: Mapping[str, bytes], folder: Path) -> None:
    """Write `files` into a hidden folder beside `folder` and move them over, so that no half-made folder is left."""
    target = folder.resolve()
    staging = target.parent / f".{target.name}.{os.getpid()}.partial"
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        staging.mkdir()
        for name, content in files.items():
            (staging / name).write_bytes(content)
        if target.exists():
            for name in files:
                os.replace(staging / name, target / name)
            staging.rmdir()
        else:
            staging.rename(target)
    except OSError as e:
        raise NetgenError(f"cannot write the scenario to {folder}: {e.strerror or e}; choose another folder") from e
    finally:
        shutil.rmtree(staging, ignore_errors=True)
