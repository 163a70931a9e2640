"""Malformed input: mutations of every kind of file that the package reads, given to the commands that read them."""
