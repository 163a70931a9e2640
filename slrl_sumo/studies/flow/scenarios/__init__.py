"""The networks of the flow benchmark with their demand: what writes the files of each situation."""
