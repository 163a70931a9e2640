"""Text files that are complete on disk after each added part."""

import zlib
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from slrl_sumo.errors import InputError
from slrl_sumo.formats.output_files import check_writable

_GZIP = 16 + zlib.MAX_WBITS
"""Window of zlib that writes the header and the checksum of a gzip file."""


class GrowingFile:
    """A file of `head`, parts and `tail`, compressed if its name ends in .gz; a context manager.

    The file is complete after each `put`, also if the process dies: each part overwrites the tail and adds it again.
    Raises InputError, with path and reason, if the file cannot be written; it then ends with the previous part and is
    closed.
    """

    def __init__(self, path: Path, head: str, tail: str) -> None:
        self.path = path
        check_writable(path)
        self._stream = zlib.compressobj(4, wbits=_GZIP) if path.name.endswith(".gz") else None
        self._end = tail.encode()
        self._whole = 0
        """Bytes on disk up to the last complete part; the tail follows, and the next part overwrites it."""
        self._tail = b""
        try:
            self._file = open(path, "wb", buffering=0)  # noqa: SIM115 (closed by close)
        except OSError as e:
            raise InputError(f"cannot write {path}: {e.strerror or e}") from e
        self.put(head)

    @property
    def closed(self) -> bool:
        """Whether the file is closed, so that nothing more can be added."""
        return self._file.closed

    def put(self, text: str) -> None:
        """Add a part, followed by the tail; if that fails, the file ends as before."""
        before = self._whole + len(self._tail)
        try:
            data, tail = self._encoded(text)
            self._write(self._whole, data + tail)
            if self._whole + len(data) + len(tail) < before:
                self._file.truncate()
        except BaseException as error:  # an interrupt must not leave half a part behind either
            with suppress(OSError):
                self._file.truncate(self._whole)
                self._write(self._whole, self._tail)
            self._file.close()
            if not isinstance(error, OSError):
                raise
            raise InputError(f"cannot write {self.path}: {error.strerror or error}") from error
        self._whole += len(data)
        self._tail = tail

    def close(self) -> None:
        """Finish the file. May be called twice."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _encoded(self, text: str) -> tuple[bytes, bytes]:
        """The bytes of `text`, and the bytes that complete a valid file after it."""
        if self._stream is None:
            return text.encode(), self._end
        # All of the part leaves the compressor; a copy of it ends the file.
        data = self._stream.compress(text.encode()) + self._stream.flush(zlib.Z_SYNC_FLUSH)
        end = self._stream.copy()
        return data, end.compress(self._end) + end.flush()

    def _write(self, at: int, data: bytes) -> None:
        self._file.seek(at)
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest) :]
