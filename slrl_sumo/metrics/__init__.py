"""What is measured: counters, safety, realism, trips, signals. Pure functions and accumulators."""
