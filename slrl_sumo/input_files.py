"""Input files, opened so that a hostile or damaged one is refused early: no pipes, bounded content, plain XML.

All functions raise OSError with a reason in words: readers report it as they report a file that is missing.

Content that is larger in memory than on disk is bounded: gzip, NPZ and Parquet files and pictures may take
SLRL_SUMO_INPUT_MIB (an environment variable, 256 by default) of memory, compressed streams 30 times their size on disk
if that is more. Settings, which are read at once, may have a sixteenth of it.
"""

import errno
import io
import json
import math
import os
import re
import stat
import tomllib
import zlib
from abc import abstractmethod
from collections.abc import Iterator
from typing import IO, Any, cast

LIMIT_VARIABLE = "SLRL_SUMO_INPUT_MIB"
DEFAULT_MIB = 256
RATIO = 30
"""Highest ratio of content to size on disk beyond the limit: XML traces have 6, zeros 1,000."""
TEXT_SHARE = 16
"""Settings may have this fraction of the limit: parsed JSON takes many times the memory of its text."""
LINE = 1 << 20
"""Bytes: longest line of a table."""
BLOCK = 1 << 20
CHUNK = 1 << 15
"""Bytes unpacked at once: what comes before damage is lost from here on."""

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
_DECLARATION = b"<!DOCTYPE"
_PLAIN_ENCODING = re.compile(rb"(?i)(utf-?8|us-ascii|ascii|iso-?8859-\d+|latin-?\d|windows-125\d|cp125\d)$")
_ENCODING = re.compile(rb"""^<\?xml[^>]{0,80}encoding\s*=\s*["']([^"']{0,40})["']""")


def refusal(reason: str, number: int = errno.EINVAL) -> OSError:
    """The error for a file that is not read because of its content."""
    return OSError(number, reason)


def open_input(path: str | os.PathLike[str]) -> IO[bytes]:
    """Open a regular file. Raises OSError for anything else, at once: opening a pipe would wait for its writer."""
    # A terminal must not become that of this process either.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY)
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        kind = next((name for test, name in _KINDS if test(mode)), "no regular file")
        raise refusal(f"it is {kind}; give a file")
    return open(descriptor, "rb")


def content_limit() -> int:
    """Bytes of memory that the content of one input file may take, from the environment variable."""
    text = os.environ.get(LIMIT_VARIABLE, "")
    try:
        return (int(text) if text.strip() else DEFAULT_MIB) << 20
    except ValueError:
        raise refusal(f"the environment variable {LIMIT_VARIABLE} is {text!r}: give a number of MiB") from None


def check_content(size: int, on_disk: int = 0) -> None:
    """Raise OSError where content of `size` bytes exceeds the limit, and RATIO times the size `on_disk`."""
    limit = content_limit()
    if size > max(limit, RATIO * on_disk):
        more = f" and {RATIO} times its size" if on_disk else ""
        raise refusal(
            f"its content takes more than {limit >> 20} MiB{more}; set {LIMIT_VARIABLE} to the MiB that it may take",
            errno.EFBIG,
        )


def read_text(path: str | os.PathLike[str]) -> str:
    """The text of a file with settings, UTF-8. Raises OSError, UnicodeDecodeError."""
    most = content_limit() // TEXT_SHARE
    with open_input(path) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise refusal(
            f"it has more than {most >> 20} MiB, too much for settings; set {LIMIT_VARIABLE} to {TEXT_SHARE} times "
            "the MiB that it has",
            errno.EFBIG,
        )
    return data.decode("utf-8")


def read_json(path: str | os.PathLike[str]) -> Any:
    """The values in a JSON file. Raises OSError, ValueError."""
    return parse_json(read_text(path))


def parse_json(text: str) -> Any:
    """The values in a JSON text. Raises ValueError."""
    try:
        return json.loads(text, parse_float=_finite)
    except RecursionError:
        raise ValueError("its brackets are nested too deeply") from None


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text[:20]} is too large")
    return value


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The values in a TOML file. Raises OSError, ValueError."""
    try:
        return tomllib.loads(read_text(path))
    except RecursionError:
        raise ValueError("its brackets are nested too deeply") from None


def text_lines(file: IO[bytes]) -> Iterator[str]:
    """The lines of a table, decoded. Raises OSError for a line longer than LINE, UnicodeDecodeError."""
    while line := file.readline(LINE):
        if len(line) == LINE and not line.endswith(b"\n"):
            raise refusal(f"it has a line of more than {LINE >> 20} MiB: it is no table")
        yield line.decode()


def check_lines(path: str | os.PathLike[str]) -> None:
    """Raise OSError where a file is no regular one, or has a line longer than LINE: others may then read it whole."""
    length = 0
    with open_input(path) as file:
        while block := file.read(BLOCK):
            first, last = block.find(b"\n"), block.rfind(b"\n")
            length = length + len(block) if first < 0 else len(block) - last - 1
            if length > LINE:
                raise refusal(f"it has a line of more than {LINE >> 20} MiB: it is no table")


def unpacked(file: IO[bytes]) -> IO[bytes]:
    """The content of a file from `open_input`: unpacked where it is gzip, up to the limit; else the file itself."""
    packed = file.read(2) == b"\x1f\x8b"
    file.seek(0)
    return io.BufferedReader(_Unpacked(file), CHUNK) if packed else file


def plain_xml(file: IO[bytes]) -> IO[bytes]:
    """The content of an XML file from `open_input`, plain or gzip. Raises OSError where it declares entities.

    They can make gigabytes of a line and include other files, and SUMO's files have none.
    """
    return io.BufferedReader(_PlainXml(unpacked(file)), CHUNK)


def open_xml(path: str | os.PathLike[str]) -> IO[bytes]:
    """`plain_xml` of a file by name."""
    return plain_xml(open_input(path))


class _Checked(io.RawIOBase):
    """What reads a stream and checks the content; closes it with itself."""

    def __init__(self, stream: io.BufferedIOBase | IO[bytes]) -> None:
        self._stream = cast(io.BufferedReader, stream)

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._stream.tell()

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._stream.seek(offset, whence)

    def close(self) -> None:
        self._stream.close()
        super().close()

    def readinto(self, buffer: Any) -> int:
        data = self._checked(len(buffer))
        buffer[: len(data)] = data
        return len(data)

    @abstractmethod
    def _checked(self, size: int) -> bytes:
        """The next bytes, at most `size`; none at the end."""


class _Unpacked(_Checked):
    """The content of a gzip file, up to the limit. Zeros behind it are padding, which gzip.GzipFile reads singly."""

    def __init__(self, file: IO[bytes]) -> None:
        super().__init__(file)
        self._on_disk = os.fstat(file.fileno()).st_size
        self.seek(0)

    def tell(self) -> int:
        return self._count

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        if offset or whence:
            raise io.UnsupportedOperation("packed content is read from its beginning")
        self._count, self._packed = 0, b""
        self._member: Any = None
        return self._stream.seek(0)

    def _checked(self, size: int) -> bytes:
        while True:
            self._packed = self._packed or self._stream.read1(CHUNK)
            if self._member is None:
                if not self._packed.lstrip(b"\0"):
                    return b""
                self._member = zlib.decompressobj(31)
            if not self._packed:
                raise refusal("it is cut off")
            try:
                data = self._member.decompress(self._packed, size)
            except zlib.error as error:
                raise refusal(f"it is not a sound gzip file ({error})") from None
            self._packed = self._member.unconsumed_tail
            if self._member.eof:
                self._packed, self._member = self._member.unused_data, None
            self._count += len(data)
            check_content(self._count, self._on_disk)
            if data:
                return bytes(data)


class _PlainXml(_Checked):
    """The text of an XML file without declared entities."""

    def __init__(self, stream: IO[bytes]) -> None:
        super().__init__(stream)
        self._before = b""

    def _checked(self, size: int) -> bytes:
        begins = self._stream.tell() == 0
        data = self._stream.read1(size)
        # In another encoding the declaration would look otherwise.
        if begins and data:
            text = data.removeprefix(b"\xef\xbb\xbf")
            encoding = _ENCODING.match(text)
            if not text.lstrip().startswith(b"<"):
                raise refusal("it is no XML text in UTF-8")
            if encoding and not _PLAIN_ENCODING.match(encoding[1]):
                raise refusal(f"its encoding is {encoding[1].decode(errors='replace')}; write it in UTF-8")
        if b"\0" in data:
            raise refusal("it holds zero bytes: it is damaged, or no XML text in UTF-8")
        if _DECLARATION in self._before + data:
            raise refusal("it declares a document type or entities (<!DOCTYPE), which are not read; remove that")
        self._before = (self._before + data)[-len(_DECLARATION) :]
        return data
