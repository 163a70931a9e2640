"""Worker processes with crash isolation and retry; Ray; signals."""
