"""The errors that the package raises on purpose.

SlrlError
├── InputError      what the user gave is wrong: one line says what, where and how to mend it (exit code 1)
└── SumoError       SUMO itself failed while running (exit code 3)
"""


class SlrlError(Exception):
    """Base of all errors of this package; the message is one line for the user."""


class InputError(SlrlError):
    """What the user gave is wrong. The message says what, where and how to mend it."""


class SumoError(SlrlError):
    """SUMO refused to go on or died while a simulation was running."""
