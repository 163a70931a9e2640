"""Networks and demand for SUMO, made with netgenerate. Imports nothing of slrl_sumo."""
