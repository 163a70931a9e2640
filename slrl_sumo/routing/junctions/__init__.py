"""Junctions: conflict areas, right of way, occupants and reservations."""
