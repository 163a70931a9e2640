"""What a road user sees."""
