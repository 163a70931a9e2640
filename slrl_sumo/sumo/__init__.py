"""All calls of SUMO's API; the only folder that imports libsumo. Modules elsewhere pass a SumoApi on to it."""
