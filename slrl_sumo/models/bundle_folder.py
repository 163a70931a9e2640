"""Locations of bundles: shipped bundles by name, and folders. Needs no PyTorch."""

from pathlib import Path

from slrl_sumo.errors import InputError

DEFAULT_BUNDLE = "intersection"
"""The default bundle of commands and functions, a shipped one."""
SHIPPED = Path(__file__).parent.parent / "bundles"
FILES = ("config.json", "weights.safetensors", "training.json", "MODEL_CARD.md")
NOTICE = "NOTICE"
"""File with the notice that the data's licence requires."""
POLICY_FILES = ("selector.json", "selector.safetensors")
"""Files of the trained selector."""


def shipped_bundles() -> list[str]:
    """Names of the shipped bundles, sorted."""
    return sorted(path.parent.name for path in SHIPPED.glob("*/config.json"))


def find_bundle(name_or_folder: str | Path) -> Path:
    """The folder of a bundle: a shipped bundle by name, or a given folder.

    A string without a slash is searched among the shipped bundles first. Raises InputError if the bundle or one of its
    files does not exist.
    """
    name = str(name_or_folder)
    folder = SHIPPED / name if name in shipped_bundles() else Path(name_or_folder)
    if not folder.is_dir():
        known = ", ".join(shipped_bundles()) or "none"
        raise InputError(f"no bundle {name}: neither a folder nor one of the shipped bundles ({known})")
    missing = [file for file in FILES if not (folder / file).is_file()]
    if missing:
        raise InputError(f"bundle {folder}: {', '.join(missing)} missing; give a folder that `slrl-sumo fit` made")
    return folder


def usual_selector_of(name_or_folder: str | Path) -> str:
    """The result of `agent.make_driver.usual_selector` for a bundle, without reading its trained selector."""
    folder = find_bundle(name_or_folder)
    return "greedy" if any((folder / file).is_file() for file in POLICY_FILES) else "rule"


def check_replaceable(folder: Path) -> None:
    """Raise InputError if `folder` contains anything but a bundle, because a new bundle would replace it."""
    if not folder.exists():
        return
    names = {path.name for path in folder.iterdir()} if folder.is_dir() else {folder.name}
    if names and not (names <= {*FILES, NOTICE, *POLICY_FILES} and "config.json" in names):
        raise InputError(f"cannot write bundle {folder}: something else is there; name a new folder for --out")
