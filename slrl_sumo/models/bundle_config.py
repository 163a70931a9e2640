"""The configuration of a bundle: required version and features, and the shapes of its networks."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from slrl_sumo.errors import InputError
from slrl_sumo.models.motion_models import MODES
from slrl_sumo.perception.features import FEATURES, STATES
from slrl_sumo.scene.types import DECISION_INTERVAL

FORMAT_VERSION = 1
"""Format version of the files of a bundle; other versions are refused."""


@dataclass(frozen=True)
class BundleConfig:
    """Properties in which a bundle must agree with the code that runs it, and the shapes of its networks."""

    format_version: int = FORMAT_VERSION
    preset: str = "paper"
    """The vector that the models read, one of features.STATES."""
    features: tuple[str, ...] = FEATURES
    decision_interval_s: float = DECISION_INTERVAL
    modes: int = MODES
    displacement_hidden: tuple[int, ...] = (32, 32)
    prior_hidden: tuple[int, ...] = (64, 64)

    @classmethod
    def read(cls, values: dict[str, Any], where: Path) -> Self:
        """The configuration in the JSON object `values`. Raises InputError unless this version can run it."""
        version = values.get("format_version")
        if version != FORMAT_VERSION:
            raise InputError(
                f"bundle {where}: its format version is {version}, this slrl_sumo reads {FORMAT_VERSION}; "
                "make the bundle again with `slrl-sumo fit`"
            )
        if set(values) != set(asdict(cls())):
            odd = ", ".join(sorted(set(values) ^ set(asdict(cls()))))
            raise InputError(f"bundle {where}: config.json is damaged (missing or unknown: {odd}); copy it again")
        as_written: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        config = cls(**as_written)
        preset = config.preset if config.preset in STATES else cls.preset
        runs = cls(
            preset=preset,
            features=STATES[preset],
            modes=config.modes,
            displacement_hidden=config.displacement_hidden,
            prior_hidden=config.prior_hidden,
        )
        if config != runs:
            odd = next(k for k, v in asdict(runs).items() if v != getattr(config, k))
            raise InputError(
                f"bundle {where}: its {odd} is {getattr(config, odd)!r}, this slrl_sumo runs {getattr(runs, odd)!r}; "
                "take another bundle"
            )
        layers = (config.displacement_hidden, config.prior_hidden)
        sizes = [config.modes, *(size for hidden in layers if isinstance(hidden, tuple) for size in hidden)]
        whole = all(isinstance(hidden, tuple) for hidden in layers)
        if not whole or len(sizes) > 64 or not all(type(size) is int and 0 < size <= 4096 for size in sizes):
            raise InputError(f"bundle {where}: config.json is damaged (sizes of networks); copy the bundle again")
        return config
