"""Scenarios that ship with the package: data only, one folder each."""
