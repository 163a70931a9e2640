"""Where road users are going: tracked vehicles and pedestrians, lane graph, walk graph, right of way."""
