"""SUMO scenarios: where they are and what their configuration says."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

from lxml import etree

from slrl_sumo.errors import InputError


@dataclass(frozen=True)
class Scenario:
    """A SUMO configuration on disk and the options written in it (not SUMO's defaults)."""

    name: str
    config: Path
    options: Mapping[str, str]
    """Option name to value, as the file has them; with those that the user has added."""
    added: Mapping[str, str] = field(default_factory=dict)
    """Those of `options` that are not in the file: SUMO must be told."""

    def seconds(self, option: str) -> float | None:
        """An option that is a time, in s; None where the file does not set it or sets it to -1 (SUMO's "none").

        SUMO writes times as seconds or as [days:]hours:minutes:seconds.
        """
        text = self.options.get(option)
        if text is None:
            return None
        try:
            parts = [float(p) for p in text.split(":")]
        except ValueError:
            raise InputError(
                f"{self.config}: option {option} is '{text}', which is no time; give seconds or hh:mm:ss"
            ) from None
        value = 0.0
        for part, scale in zip(reversed(parts), (1, 60, 3600, 86400), strict=False):
            value += part * scale
        return value if value >= 0 else None


def shipped_scenarios() -> list[str]:
    """Names of the scenarios that ship with the package, sorted."""
    root = Path(str(files("sumo_scenarios")))
    return sorted(p.parent.name for p in root.glob("*/*.sumocfg"))


def find_scenario(text: str) -> Scenario:
    """The scenario that `text` names: a shipped name, a folder with one .sumocfg, or a .sumocfg file.

    Raises InputError when there is none or the file is not a SUMO configuration.
    """
    path = Path(text)
    if path.is_dir():
        configs = sorted(path.glob("*.sumocfg"))
        if len(configs) != 1:
            found = "no .sumocfg" if not configs else f"{len(configs)} .sumocfg files"
            raise InputError(f"{path}: {found} in this folder; give the path of the .sumocfg to run")
        return read_scenario(configs[0])
    if path.is_file():
        return read_scenario(path)
    if text in shipped_scenarios():
        folder = Path(str(files("sumo_scenarios"))) / text
        return read_scenario(next(folder.glob("*.sumocfg")), name=text)
    raise InputError(
        f"{text}: no such file, folder or shipped scenario; "
        f"give a .sumocfg, or one of: {', '.join(shipped_scenarios())}"
    )


def read_scenario(config: Path, name: str | None = None) -> Scenario:
    """Read the options of a SUMO configuration file. Raises InputError when it is none."""
    try:
        root = etree.parse(str(config)).getroot()
    except OSError as error:
        raise InputError(f"{config}: cannot be read ({error.strerror or error})") from None
    except etree.XMLSyntaxError as error:
        raise InputError(f"{config}: not a SUMO configuration ({error.msg}); give a .sumocfg") from None
    # "configuration" and "sumoConfiguration" are both in use; a network or a route file given by mistake is neither.
    if not str(root.tag).lower().endswith("configuration"):
        raise InputError(f"{config}: this is a <{root.tag}> file, not a SUMO configuration; give a .sumocfg")
    options = {str(e.tag): e.get("value", e.get("v", "")) for e in root.iter() if isinstance(e.tag, str) and e.attrib}
    options = {key.replace("_", "-"): value for key, value in options.items() if key != root.tag}
    return Scenario(name=name or config.stem, config=config, options=options)
