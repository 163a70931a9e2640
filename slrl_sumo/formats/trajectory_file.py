"""Trajectories from the file that `Trajectories.save` writes."""

import os
import zipfile
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import DTYPES, FILE_KIND, FILE_VERSION, OPTIONAL, Trajectories
from slrl_sumo.input_files import check_content, open_input

_SINGLE = ("kind", "version", "dt", "t0", "source", "licence")
"""Entries that are one value."""


def load_trajectories(path: str | os.PathLike[str]) -> Trajectories:
    """Read what `Trajectories.save` wrote. Raises InputError if the file is missing, damaged or of another kind."""
    name = os.fspath(path)
    try:
        with open_input(path) as file:
            data = _arrays(name, file)
        return Trajectories(
            ids=tuple(data["ids"].tolist()),
            dt=float(data["dt"]),
            t0=float(data["t0"]),
            source=str(data["source"]),
            licence=str(data["licence"]),
            notes=tuple(data["notes"].tolist()) if "notes" in data else (),
            **{
                name: data[name].astype(dtype, casting="safe")
                for name, dtype in DTYPES.items()
                if name in data or name not in OPTIONAL
            },
        )
    except OSError as e:
        raise InputError(f"cannot read {name}: {e.strerror or e}") from e
    except (ValueError, TypeError, KeyError) as e:
        raise InputError(f"{name} is not a trajectories file or is damaged: {' '.join(str(e).split())}") from e


def _arrays(name: str, file: IO[bytes]) -> dict[str, NDArray[Any]]:
    """The arrays of the file. Raises InputError for another kind or version, OSError, ValueError."""
    try:
        with zipfile.ZipFile(file) as archive:
            members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            if "kind" not in members or str(_array(archive, members["kind"])) != FILE_KIND:
                raise InputError(f"{name} is not a trajectories file; make one with `slrl-sumo import`")
            version = int(_array(archive, members["version"]))
            if not 1 <= version <= FILE_VERSION:
                raise InputError(
                    f"{name} has trajectories format {version}, this version reads 1 to {FILE_VERSION}; "
                    "make the file anew with `slrl-sumo import` or `slrl-sumo record`"
                )
            wanted = [members[key] for key in ("ids", "notes", *_SINGLE, *DTYPES) if key in members]
            check_content(sum(info.file_size for info in wanted), os.fstat(file.fileno()).st_size)
            return {info.filename.removesuffix(".npy"): _array(archive, info) for info in wanted}
    except (InputError, OSError):
        raise
    except zipfile.BadZipFile as e:
        raise ValueError(str(e)) from e
    except Exception as e:
        # zipfile and numpy raise ten kinds of errors where headers are damaged, from struct.error to TokenError.
        raise ValueError(f"{type(e).__name__}: {e}") from e


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    """One array; ValueError if its header does not match its size, so that nothing larger is allocated."""
    with archive.open(info) as stream:
        version = np.lib.format.read_magic(stream)
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read_header(stream)
        size = dtype.itemsize * int(np.prod([int(n) for n in shape], dtype=object))
        if dtype.hasobject or fortran or min(shape, default=0) < 0 or size != info.file_size - stream.tell():
            raise ValueError(f"{info.filename} has a damaged header")
        return np.frombuffer(stream.read(size), dtype).reshape(shape)
