"""What in a scenario will hurt, before a run."""
