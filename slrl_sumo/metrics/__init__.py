"""What is measured: conflicts, safety, realism, queues, counters of a run, trips, signals.

Pure functions on trajectories; accumulators that follow a run (counters of simulation.events); `trips` and
`signal_crossings` also ask SUMO, through slrl_sumo.sumo.
"""
