"""Worker processes with crash isolation and retry, on this machine or on a Ray cluster; signals; progress bars."""
