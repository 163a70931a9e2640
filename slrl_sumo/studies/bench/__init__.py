"""Throughput on this machine."""
