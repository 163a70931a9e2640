"""SUMO scenarios: search for a scenario, and the options of its configuration."""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

from lxml import etree

from slrl_sumo.errors import InputError
from slrl_sumo.formats.sumo_time import parse_time
from slrl_sumo.input_files import open_xml


@dataclass(frozen=True)
class Scenario:
    """A SUMO configuration on disk and the options in it (not SUMO's defaults)."""

    name: str
    config: Path
    options: Mapping[str, str]
    """Values by option name, from the file and added by the user."""
    added: Mapping[str, str] = field(default_factory=dict)
    """The part of `options` that is not in the file and goes on SUMO's command line."""

    def seconds(self, option: str) -> float | None:
        """An option with a time, in s; None if it is not set, or set to -1 (SUMO's "none")."""
        text = self.options.get(option)
        if text is None:
            return None
        value = parse_time(text)
        if value is None:
            raise InputError(f"{self.config}: option {option} is '{text}', which is no time; give seconds or hh:mm:ss")
        return value if value >= 0 else None


def shipped_scenarios() -> list[str]:
    """Names of the scenarios in the package, sorted."""
    root = Path(str(files("slrl_sumo.scenarios")))
    return sorted(p.parent.name for p in root.glob("*/*.sumocfg"))


def find_scenario(text: str) -> Scenario:
    """The scenario that `text` names: a shipped name, a folder with one .sumocfg, or a .sumocfg file.

    A folder without a .sumocfg does not hide the shipped scenario of the same name, because outputs are in such
    folders. Raises InputError if there is no such scenario, or if the file is not a SUMO configuration.
    """
    path = Path(text)
    if path.is_dir():
        configs = sorted(path.glob("*.sumocfg"))
        if not configs and text in shipped_scenarios():
            return _shipped(text)
        if len(configs) != 1:
            found = "no .sumocfg" if not configs else f"{len(configs)} .sumocfg files"
            raise InputError(f"{path}: {found} in this folder; give the path of the .sumocfg to run")
        return read_scenario(configs[0])
    if path.is_file():
        return read_scenario(path)
    if text in shipped_scenarios():
        return _shipped(text)
    near = difflib.get_close_matches(text, shipped_scenarios(), n=1)
    raise InputError(
        f"{text}: no such file, folder or shipped scenario; {f'is it {near[0]}? ' if near else ''}"
        f"give a .sumocfg, or one of: {', '.join(shipped_scenarios())}"
    )


def _shipped(name: str) -> Scenario:
    folder = Path(str(files("slrl_sumo.scenarios"))) / name
    return read_scenario(next(folder.glob("*.sumocfg")), name=name)


def read_scenario(config: Path, name: str | None = None) -> Scenario:
    """Read the options of a SUMO configuration file. Raises InputError for any other file."""
    try:
        with open_xml(config) as file:
            root = etree.parse(file).getroot()
    except OSError as error:
        raise InputError(f"{config}: cannot be read ({error.strerror or error})") from None
    except etree.XMLSyntaxError as error:
        raise InputError(f"{config}: not a SUMO configuration ({error.msg}); give a .sumocfg") from None
    # Both "configuration" and "sumoConfiguration" are in use; networks and route files have other roots.
    if not str(root.tag).lower().endswith("configuration"):
        raise InputError(f"{config}: this is a <{root.tag}> file, not a SUMO configuration; give a .sumocfg")
    options = {str(e.tag): e.get("value", e.get("v", "")) for e in root.iter() if isinstance(e.tag, str) and e.attrib}
    options = {key.replace("_", "-"): value for key, value in options.items() if key != root.tag}
    return Scenario(name=name or config.stem, config=config, options=options)
