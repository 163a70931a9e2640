"""What traffic engineering measures: trips, queues, density, corridors, crossings of signals."""
