"""Problems of a scenario, found before a run."""
