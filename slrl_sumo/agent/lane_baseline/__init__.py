"""The baseline `lane`: road users that follow their lanes and routes roughly as SUMO's do, without models."""
