"""The error that netgen raises on purpose."""


class NetgenError(ValueError):
    """A network or its demand cannot be made. The message is one line: what, where and how to mend it."""
