"""Pictures that are no masks."""

import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.ground.mask import ground_of_mask


def png(width: int, height: int, data: bytes) -> bytes:
    """A PNG with this size in its header, whatever it holds."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.parametrize("side", [20_000, 12_000, 2**31 - 1])
def test_large_pictures_are_refused_before_they_are_unpacked(tmp_path: Path, side: int) -> None:
    file = tmp_path / "mask.png"
    file.write_bytes(png(side, side, zlib.compress(bytes(100_000))))
    with pytest.raises(InputError, match=r"mask\.png: cannot be read as a picture"):
        ground_of_mask(file, 0.05)


def test_the_limit_is_that_of_all_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "mask.png"
    cv2.imwrite(str(file), np.full((400, 400, 3), 255, np.uint8))
    monkeypatch.setenv("SLRL_SUMO_INPUT_MIB", "4")
    with pytest.raises(InputError, match="more than 4 MiB; set SLRL_SUMO_INPUT_MIB"):
        ground_of_mask(file, 0.05)
    monkeypatch.setenv("SLRL_SUMO_INPUT_MIB", "6")
    ground_of_mask(file, 0.05)


def test_damaged_pictures_get_one_line(tmp_path: Path) -> None:
    file = tmp_path / "mask.png"
    cv2.imwrite(str(file), np.full((400, 400, 3), 255, np.uint8))
    whole = file.read_bytes()
    for content in (whole[: len(whole) // 2], b"", whole[:20], png(40, 40, b"no deflate"), b"GIF89a" + bytes(50)):
        file.write_bytes(content)
        with pytest.raises(InputError, match=r"mask\.png: cannot be read as a picture .*; give a PNG") as error:
            ground_of_mask(file, 0.05)
        assert "\n" not in str(error.value)
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(InputError, match="it is a pipe"):
        ground_of_mask(file, 0.05)


def test_specks_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "mask.png"
    dots = np.zeros((800, 800, 3), np.uint8)
    dots[::2, ::2] = 255
    cv2.imwrite(str(file), dots)
    with pytest.raises(InputError, match="separate spots"):
        ground_of_mask(file, 0.05)
