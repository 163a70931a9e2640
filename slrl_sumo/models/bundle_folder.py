"""Where bundles lie: the shipped ones by name, and folders. Needs no PyTorch."""

from pathlib import Path

from slrl_sumo.errors import InputError

DEFAULT_BUNDLE = "intersection"
"""The shipped bundle that commands and functions take where none is named."""
SHIPPED = Path(__file__).parent.parent / "bundles"
FILES = ("config.json", "weights.safetensors", "training.json", "MODEL_CARD.md")
NOTICE = "NOTICE"
"""The notice of a licence, where the data asks for one."""
POLICY_FILES = ("selector.json", "selector.safetensors")
"""Of the trained selector, where there is one."""


def shipped_bundles() -> list[str]:
    """Names of the bundles that come with the package, sorted."""
    return sorted(path.parent.name for path in SHIPPED.glob("*/config.json"))


def find_bundle(name_or_folder: str | Path) -> Path:
    """The folder of a bundle: one that comes with the package, by name, or the folder that is named.

    A string without a slash is searched among the shipped bundles first. Raises InputError where there is no such
    bundle, or one of its files is missing.
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
    """What `agent.make_driver.usual_selector` says of a bundle, without reading its trained selector."""
    folder = find_bundle(name_or_folder)
    return "greedy" if any((folder / file).is_file() for file in POLICY_FILES) else "rule"


def check_replaceable(folder: Path) -> None:
    """Raise InputError where `folder` holds anything else than a bundle, which a new bundle would replace."""
    if not folder.exists():
        return
    names = {path.name for path in folder.iterdir()} if folder.is_dir() else {folder.name}
    if names and not (names <= {*FILES, NOTICE, *POLICY_FILES} and "config.json" in names):
        raise InputError(f"cannot write bundle {folder}: something else is there; name a new folder for --out")
