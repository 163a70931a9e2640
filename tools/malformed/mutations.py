"""What is done to a valid file. Every mutation changes the file in place and returns a note on what it did."""

import gzip
import io
import json
import os
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from random import Random

import numpy as np

Mutation = Callable[[Path, Random], str]

ODD = (
    *("inf", "-inf", "nan", "-1", "0", "1e30", "-1e30", "1e308", "1e999", "9" * 400, "-0.0", "7", "2147483648"),
    *("18446744073709551616", "", "word", "\u00e4\u4e2d", "1,2", "0x10", "true", "[]", "null", "../../etc/passwd"),
)
DEEP = 100_000
BOMB = 10 << 30
"""Bytes that a bomb unpacks to."""


def _text(path: Path) -> str:
    data = path.read_bytes()
    return (gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data).decode("utf-8", errors="replace")


def _write(path: Path, text: str) -> None:
    data = text.encode()
    path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)


def truncated(path: Path, random: Random) -> str:
    data = path.read_bytes()
    keep = random.randrange(len(data) or 1)
    path.write_bytes(data[:keep])
    return f"{keep} of {len(data)} bytes"


def bits_flipped(path: Path, random: Random) -> str:
    data = bytearray(path.read_bytes())
    places = [random.randrange(len(data)) for _ in range(random.choice((1, 10, 100)))] if data else []
    for place in places:
        data[place] ^= 1 << random.randrange(8)
    path.write_bytes(bytes(data))
    return f"{len(places)} bits"


def bytes_inserted(path: Path, random: Random) -> str:
    data = path.read_bytes()
    place = random.randrange(len(data) + 1)
    path.write_bytes(data[:place] + random.randbytes(random.choice((1, 50, 5000))) + data[place:])
    return f"at {place}"


def empty(path: Path, random: Random) -> str:
    path.write_bytes(b"")
    return ""


def wrong_kind(path: Path, random: Random) -> str:
    others = {
        "text": b"This is a letter.\n" * 20,
        "noise": random.randbytes(4000),
        "zip": b"PK\x05\x06" + bytes(18),
        "json": b'{"a": [1, 2, {"b": null}]}',
        "xml": b"<a><b c='d'/></a>",
        "png": b"\x89PNG\r\n\x1a\n" + bytes(40),
        "table": b"a,b,c\n1,2,3\n4,5,6\n",
    }
    kind = random.choice(sorted(others))
    path.write_bytes(others[kind])
    return kind


def no_file(path: Path, random: Random) -> str:
    path.unlink()
    kind = random.choice(("pipe", "device", "folder", "loop", "missing", "full"))
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind != "missing":
        path.symlink_to({"device": "/dev/zero", "full": "/dev/full", "loop": path.name}[kind])
    return kind


def pipe(path: Path, random: Random) -> str:
    path.unlink()
    os.mkfifo(path)
    return ""


def huge(path: Path, random: Random) -> str:
    """Zeros behind the content that take no room on the disk."""
    os.truncate(path, BOMB)
    return f"{BOMB} bytes"


def packed_bomb(path: Path, random: Random) -> str:
    """Zeros, spaces or the content and spaces, packed."""
    filler = random.choice((b"\0", b" "))
    begin = b"<a>" if random.random() < 0.5 else path.read_bytes()[:2000] if path.suffix != ".gz" else b""
    block = gzip.compress(filler * (64 << 20), 9)
    path.write_bytes((gzip.compress(begin) if begin else b"") + block * (BOMB // (64 << 20)))
    return f"{filler!r} behind {begin[:3]!r}"


def odd_value(path: Path, random: Random) -> str:
    """A value of XML, JSON, TOML or CSV replaced."""
    text = _text(path)
    if path.suffix == ".csv" or path.name == "annotations.txt":
        lines = text.splitlines()
        row = random.randrange(len(lines))
        mark = ";" if ";" in lines[row] else "," if "," in lines[row] else " "
        cells = lines[row].split(mark)
        column, value = random.randrange(len(cells)), random.choice(ODD)
        cells[column] = value
        lines[row] = mark.join(cells)
        _write(path, "\n".join(lines) + "\n")
        return f"line {row + 1}, column {column}: {value[:30]!r}"
    if "<" in text[:100]:
        places = [found.span(1) for found in re.finditer(r'[\w:.-]+="([^"]*)"', text)]
    else:
        places = [found.span(1) for found in re.finditer(r'[:=\[,]\s*("[^"\n]*"|-?[\d.eE+-]+|true|false|null)', text)]
    begin, end = random.choice(places) if places else (0, 0)
    value = random.choice(ODD)
    if text[begin:end].startswith('"') and random.random() < 0.5:
        value = f'"{value}"'
    _write(path, text[:begin] + value + text[end:])
    return f"{text[max(0, begin - 25) : begin]!r} {text[begin:end][:20]!r} -> {value[:30]!r}"


def piece_dropped(path: Path, random: Random) -> str:
    """An attribute, a key or a line dropped."""
    return _pieces(path, random, 0)


def piece_doubled(path: Path, random: Random) -> str:
    """An attribute, an element, a key or a line doubled."""
    return _pieces(path, random, 2)


def _pieces(path: Path, random: Random, times: int) -> str:
    text = _text(path)
    expression = r'\s[\w:.-]+="[^"]*"|<[a-zA-Z][^<>]*/>' if "<" in text[:100] else r"[^\n]*\n|\"\w+\": [^,{}\[\]]*,"
    places = [found.span() for found in re.finditer(expression, text)]
    begin, end = random.choice(places) if places else (0, 0)
    _write(path, text[:begin] + text[begin:end] * times + text[end:])
    return f"{text[begin:end][:60]!r} {times} times"


def deep(path: Path, random: Random) -> str:
    """Brackets or elements within each other."""
    text = _text(path)
    if "<" in text[:100]:
        end = text.rfind("</")
        _write(path, text[:end] + "<param>" * DEEP + "</param>" * DEEP + text[end:])
    elif path.suffix == ".toml":
        _write(path, "a = " + "[" * DEEP + "]" * DEEP + "\n" + text)
    elif random.random() < 0.5:
        _write(path, '{"a":' * DEEP + "1" + "}" * DEEP + "\n")
    else:
        _write(path, text.rstrip().rstrip("}") + ', "x": ' + "[" * DEEP + "]" * DEEP + "}\n")
    return f"{DEEP} levels"


def entities(path: Path, random: Random) -> str:
    """Entities that expand to gigabytes, or that name another file."""
    root = re.search(r"<([a-zA-Z-]+)", re.sub(r"<\?.*?\?>|<!--.*?-->", "", _text(path), flags=re.S))
    name = root[1] if root else "a"
    if random.random() < 0.6:
        names = "abcdefghij"
        declared = "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise(names))
        declared, used = f'<!ENTITY a "laughter">{declared}', "&j;"
    else:
        declared, used = '<!ENTITY x SYSTEM "file:///etc/passwd">', "&x;"
    value = used if "SYSTEM" not in declared else ""
    _write(path, f'<!DOCTYPE {name} [{declared}]><{name}><param key="k" value="{value}"/>{used}</{name}>')
    return "expanding" if value else "external"


def included(path: Path, random: Random) -> str:
    """A file that includes itself, or, of two, the other one."""
    text = _text(path)
    end = text.rfind("</")
    if random.random() < 0.5:
        _write(path, text[:end] + f'<include href="{path.name}"/>' + text[end:])
        return "itself"
    other = path.with_name("other.xml")
    _write(path, text[:end] + f'<include href="{other.name}"/>' + text[end:])
    other.write_text(f'<routes><include href="{path.name}"/></routes>')
    return "through another file"


def encoded(path: Path, random: Random) -> str:
    """Text in another encoding."""
    encoding = random.choice(("utf-16", "utf-32", "utf-7", "cp037"))
    text = re.sub(r"^<\?.*?\?>", f"<?xml version='1.0' encoding='{encoding}'?>", _text(path))
    data = text.encode(encoding, errors="replace")
    path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)
    return encoding


def long_line(path: Path, random: Random) -> str:
    text = _text(path)
    _write(path, text + "1" * (30 << 20))
    return "30 MiB"


def array_changed(path: Path, random: Random) -> str:
    """Values of a trajectories file that cannot be, or an entry that is missing."""
    with np.load(path) as data:
        arrays = dict(data)
    rows = len(arrays["x"])
    changes = {
        "type 7": {"type": np.full(len(arrays["type"]), 7, np.int8)},
        "t0 NaN": {"t0": np.array(np.nan)},
        "t0 text": {"t0": np.array("now")},
        "dt 0": {"dt": np.array(0.0)},
        "dt inf": {"dt": np.array(np.inf)},
        "dt 0.1": {"dt": np.array(0.1)},
        "gap": {"frame": arrays["frame"] + 10**12 * (arrays["track"] > 2)},
        "early": {"frame": arrays["frame"] - 10**15},
        "small gap": {"frame": arrays["frame"] + 9_000_000 * (arrays["track"] > 2)},
        "far": {"x": arrays["x"] * 1e30},
        "far but possible": {"x": arrays["x"] + 9e7 * (arrays["track"] > 2)},
        "fast": {"x": arrays["x"] * 1e4},
        "NaN": {"y": np.full(rows, np.nan)},
        "heading 1e300": {"heading": np.full(rows, 1e300)},
        "length -1": {"length": -arrays["length"]},
        "width 0": {"width": 0 * arrays["width"]},
        "width inf": {"width": np.inf * arrays["width"]},
        "short": {"y": arrays["y"][:-1]},
        "unsorted": {"track": arrays["track"][::-1].copy()},
        "matrix": {"x": arrays["x"].reshape(-1, 2)},
        "ids twice": {"ids": np.array(["a"] * len(arrays["ids"]))},
        "ids numbers": {"ids": np.arange(len(arrays["ids"]))},
        "no rows": {k: v[:0] for k, v in arrays.items() if v.ndim},
        "complex": {"x": arrays["x"] * 1j},
        "version": {"version": np.array(99)},
        "mode": {"mode": np.full(rows, -5, np.int8)},
        "mode 120": {"mode": np.full(rows, 120, np.int8), "learned": np.ones(len(arrays["ids"]), bool)},
    }
    what = random.choice([*changes, "missing", "object"])
    arrays |= changes.get(what, {})
    if what == "missing":
        what = f"missing {(name := random.choice(sorted(arrays)))}"
        del arrays[name]
    if what == "object":
        arrays["x"] = np.array([{"a": 1}] * rows, object)
    np.savez(path, **arrays)
    return what


def array_header(path: Path, random: Random) -> str:
    """A header of an array that does not fit, or an array that unpacks to gigabytes."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    what = random.choice(("rows", "object", "order", "bomb", "bits", "negative", "brackets", "large header", "many"))
    name = random.choice(("x.npy", "track.npy", "ids.npy", "kind.npy"))
    data = members[name]
    size = struct.unpack("<H", data[8:10])[0]
    header, body = data[10 : 10 + size].decode("latin1"), data[10 + size :]
    shape = {"rows": "(1000000000000,)", "negative": "(-1,)", "brackets": "(" * 200}.get(what)
    if shape is not None:
        header = re.sub(r"\([^)]*\)", shape, header)
    kind = {"object": "'|O'", "order": "'>f8'"}.get(what)
    if kind is not None:
        header = re.sub(r"'descr': '[^']*'", f"'descr': {kind}", header)
    if what == "bits":
        header = "".join(chr(ord(c) ^ (random.random() < 0.05)) for c in header)
    if what == "large header":
        header = header.rstrip() + " " * 60_000
    members[name] = data[:8] + struct.pack("<H", len(header)) + header.encode("latin1") + body
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for key, content in members.items():
            if what == "bomb" and key == "x.npy":
                with archive.open(key, "w", force_zip64=True) as stream:
                    stream.write(_header(BOMB // 80))
                    for _ in range(BOMB // 10 >> 20):
                        stream.write(bytes(1 << 20))
            else:
                archive.writestr(key, content)
        for k in range(50_000 if what == "many" else 0):
            archive.writestr(f"{k}.npy", b"")
    return f"{what} in {name}"


def _header(rows: int) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": "<f8", "fortran_order": False, "shape": (rows,)})
    return buffer.getvalue()


def picture(path: Path, random: Random) -> str:
    """A picture that is much larger than its file, or that says so."""
    what = random.choice(("header", "blank", "noise", "sizes"))
    side = {"header": 2**31 - 1, "blank": 20_000, "noise": 2_000, "sizes": random.randrange(1, 2**16)}[what]
    rows = side if what in ("blank", "noise") else 10
    packer = zlib.compressobj(9)
    data = b"".join(
        packer.compress(b"\0" + (random.randbytes(3 * side) if what == "noise" else b"\xff" * min(3 * side, 10**6)))
        for _ in range(rows)
    )
    header = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", data + packer.flush()), (b"IEND", b""))
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + b"".join(struct.pack(">I", len(c)) + k + c + struct.pack(">I", zlib.crc32(k + c)) for k, c in chunks)
    )
    return f"{what}, {side} px"


def weights(path: Path, random: Random) -> str:
    """Tensors whose header does not fit, or whose values cannot be."""
    data = path.read_bytes()
    size = struct.unpack("<Q", data[:8])[0]
    header, body = json.loads(data[8 : 8 + size]), bytearray(data[8 + size :])
    name = random.choice(sorted(set(header) - {"__metadata__"}))
    entry = header[name]
    what = random.choice(("length", "shape", "dtype", "offsets", "dropped", "nan", "1e30", "deep"))
    if what == "shape":
        entry["shape"] = random.choice(([10**12], [0], [-1], [1] * 100, entry["shape"][::-1], ["a"]))
    elif what == "dtype":
        entry["dtype"] = random.choice(("F64", "I8", "F16", "BOOL", "X"))
    elif what == "offsets":
        entry["data_offsets"] = random.choice(([0, 10**15], [-4, 4], [8, 4], [0.5, 4]))
    elif what == "dropped":
        del header[name]
    elif what in ("nan", "1e30"):
        begin = entry["data_offsets"][0]
        body[begin : begin + 4] = struct.pack("<f", float(what))
    text = json.dumps(header).encode()
    if what == "deep":
        text = b'{"a":' * DEEP + text + b"}" * DEEP
    path.write_bytes(struct.pack("<Q", 2**60 if what == "length" else len(text)) + text + bytes(body))
    return f"{what} of {name}"


COMMON: tuple[Mutation, ...] = (
    *(truncated, bits_flipped, bits_flipped, bytes_inserted, empty, wrong_kind, no_file, pipe, huge, packed_bomb),
)
TEXT: tuple[Mutation, ...] = (odd_value, odd_value, odd_value, odd_value, piece_dropped, piece_doubled)
BY_KIND: dict[str, tuple[Mutation, ...]] = {
    "xml": (*TEXT, deep, entities, included, encoded),
    "csv": (*TEXT, long_line),
    "json": (*TEXT, deep, long_line),
    "toml": (*TEXT, deep, long_line),
    "npz": (array_changed, array_changed, array_changed, array_changed, array_header, array_header),
    "png": (picture, picture),
    "weights": (weights, weights, weights),
    "other": (),
}
"""Besides the common ones."""
