"""Everything that touches SUMO; the only place that imports libsumo."""
