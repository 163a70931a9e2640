"""Text in XML attributes."""

import re
from collections.abc import Sequence

from slrl_sumo.errors import InputError

_ESCAPES = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
)
_TO_ESCAPE = re.compile(r'[&<>"\n\r\t]')
_NOT_IN_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


def escaped(names: Sequence[str]) -> Sequence[str]:
    """Names as XML attribute values; most need no change, which one search over all of them shows.

    Raises InputError where one has a character that XML cannot hold.
    """
    together = "".join(names)
    if _NOT_IN_XML.search(together):
        bad = next(name for name in names if _NOT_IN_XML.search(name))
        raise InputError(f"id {bad!r} has a character that XML cannot hold; rename it")
    return [name.translate(_ESCAPES) for name in names] if _TO_ESCAPE.search(together) else names
