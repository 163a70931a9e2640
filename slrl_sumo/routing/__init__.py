"""Routes of road users: tracks of vehicles and pedestrians, lane graph, walk graph, junctions, speed limits."""
