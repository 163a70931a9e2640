"""The vehicle types of a trace, as an additional file (-a) for SUMO: --device.fcd-replay needs them.

python -m slrl_sumo.sumo.scenario.trace_types SCENARIO OUT.add.xml
"""

import copy
import sys
from collections.abc import Iterator
from pathlib import Path

from lxml import etree

from slrl_sumo.errors import InputError
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH
from slrl_sumo.sumo.scenario.configuration import Scenario, find_scenario
from slrl_sumo.sumo.scenario.demand import elements, reason
from slrl_sumo.sumo.scenario.input_check import check_inputs
from slrl_sumo.sumo.scenario.options import input_files
from slrl_sumo.sumo.spawned import LEARNED_TYPES

CLASSES = ("passenger", "passenger", "pedestrian")
"""Vehicle classes of learned road users, indexed by RoadUserType: bicycles use the lanes of cars (SpawnedControl)."""
SHAPES = ("passenger", "bicycle", "pedestrian")
"""How SUMO-GUI draws them."""


def trace_types(scenario: Scenario) -> etree._Element:
    """An <additional> element with the vTypes of learned road users and of the scenario's demand files."""
    root = etree.Element("additional")
    for kind, name in enumerate(LEARNED_TYPES):
        size = {"length": f"{DEFAULT_LENGTH[kind]:g}", "width": f"{DEFAULT_WIDTH[kind]:g}"}
        etree.SubElement(root, "vType", {"id": name, "vClass": CLASSES[kind], "guiShape": SHAPES[kind], **size})
    check_inputs(scenario)
    known = set(LEARNED_TYPES)
    for option in ("additional-files", "route-files"):
        for path in input_files(scenario, option):
            for vtype in _vtypes(path):
                if vtype.get("id") not in known:
                    known.add(vtype.get("id", ""))
                    vtype.tail = None
                    root.append(vtype)
    etree.indent(root, "    ")
    return root


def _vtypes(path: Path) -> Iterator[etree._Element]:
    try:
        for element in elements(path):
            if element.tag == "include" and element.get("href"):
                yield from _vtypes(path.parent / element.get("href", ""))
            # Also inside distributions: in a trace, road users have these types.
            for vtype in element.iter("vType"):
                yield copy.deepcopy(vtype)
    except (etree.XMLSyntaxError, OSError) as error:
        raise InputError(f"{path}: cannot be read ({reason(error)})") from None


def main(words: list[str]) -> None:
    """Write the types of the scenario words[0] to the file words[1]."""
    if len(words) != 2:
        raise SystemExit(__doc__)
    try:
        etree.ElementTree(trace_types(find_scenario(words[0]))).write(words[1], encoding="UTF-8", xml_declaration=True)
    except (InputError, OSError) as error:
        raise SystemExit(f"trace_types: {error}") from None


if __name__ == "__main__":
    main(sys.argv[1:])
