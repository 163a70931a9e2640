"""Addresses of Ray clusters, as the command line takes them. No Ray is needed to read them."""

import re

LOCAL = "local"
"""A Ray of our own on this machine."""

AUTO = "auto"
"""The cluster that this machine belongs to."""


def may_be_address(text: str) -> bool:
    """Whether `text` has the form of an address: local, auto or HOST:PORT."""
    return text in (LOCAL, AUTO) or re.fullmatch(r"([\w.\-]+|\[[\da-fA-F:]+\]):\d+", text) is not None
