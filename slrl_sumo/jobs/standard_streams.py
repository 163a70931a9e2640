"""The three standard streams of a process."""

import os


def open_closed_streams() -> None:
    """Open standard streams that the user has closed on /dev/null: otherwise the next files and sockets opened take
    their numbers and receive printed text."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
