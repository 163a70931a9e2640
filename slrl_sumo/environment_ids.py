"""The environments' ids in gymnasium: there as soon as this package and gymnasium are imported, in either order.

Gymnasium has had no entry points for environments since 1.0, and importing it here would double the 0.16 s of
`slrl-sumo --help`.
"""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType

IDS = {
    "slrl_sumo/Intersection-v0": {"scenario": "intersection", "bundle": "intersection"},
    "slrl_sumo/SharedSpace-v0": {"scenario": "shared-space", "bundle": "shared-space"},
    "slrl_sumo/Random-v0": {"scenario": "random", "bundle": "intersection"},
    "slrl_sumo/RoadUser-v0": {},
}
"""Keywords by id; the last one has any scenario, by keyword."""


def register_environments() -> None:
    """Register the ids now if gymnasium is imported, else when it is."""
    if "gymnasium" in sys.modules:
        _register()
    else:
        sys.meta_path.insert(0, _GymnasiumFinder())


class _GymnasiumFinder(MetaPathFinder):
    """Finds gymnasium as the others do, and registers the ids after it was executed."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """See MetaPathFinder."""
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        sys.meta_path.insert(0, self)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                if self in sys.meta_path:
                    sys.meta_path.remove(self)
                    _register()

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec


def _register() -> None:
    import gymnasium

    for name, keywords in IDS.items():
        gymnasium.register(
            name,
            "slrl_sumo.learning.environments.road_user_env:RoadUserEnv",
            vector_entry_point="slrl_sumo.learning.environments.make:vector_env",
            kwargs=dict(keywords),
        )
