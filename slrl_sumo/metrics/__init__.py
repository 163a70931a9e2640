"""What is measured: conflicts, safety, realism, counters of a run; in `traffic` trips, queues, density and signals.

Pure functions on trajectories; accumulators that follow a run (counters of simulation.events); `traffic.trips` and
`traffic.signal_crossings` also ask SUMO, through slrl_sumo.sumo.
"""
