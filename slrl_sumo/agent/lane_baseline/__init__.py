"""The baseline `lane`: road users follow their lanes and routes roughly as in SUMO, without models."""
