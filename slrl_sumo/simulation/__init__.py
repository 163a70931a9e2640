"""The loop: learned road users and SUMO, step by step."""
