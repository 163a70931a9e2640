"""Measures: conflicts, safety, realism, counters of a run; in `traffic` trips, queues, density and signals.

Most are pure functions on trajectories, or accumulators of the events of a run (simulation.events); `traffic.trips` and
`traffic.signal_crossings` also read from SUMO, through slrl_sumo.sumo.
"""
