"""Packages that only some functions need: the extras of this package."""

from importlib.util import find_spec

from slrl_sumo.errors import InputError

EXTRAS = {
    "matplotlib": "report",
    "pandas": "pandas",
    "pettingzoo": "rl",
    "pyarrow": "parquet",
    "ray": "ray",
    "sklearn": "train",
    "tensorboard": "train",
}
"""Import name and extra (pyproject.toml)."""
NAMES = {"pettingzoo": "PettingZoo", "ray": "Ray", "sklearn": "scikit-learn", "tensorboard": "TensorBoard"}


def require(module: str, purpose: str) -> None:
    """Raise InputError where a module of EXTRAS is not installed; `purpose`: what needs it, as subject of a sentence.

    Called before long work, without importing the module.
    """
    if find_spec(module) is None:
        name, extra = NAMES.get(module, module), EXTRAS[module]
        raise InputError(f"{purpose} needs {name}, which is not installed: pip install 'slrl-sumo[{extra}]'")
