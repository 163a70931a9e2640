"""Measures of traffic engineering: trips, queues, density, corridors, crossings of signals."""
