"""How many threads torch computes with."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """Torch computes in one thread meanwhile: the models are so small that more threads only wait for each other.

    Where torch is not imported, it stays so, and what imports it meanwhile computes in more threads: load a bundle
    first.
    """
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
