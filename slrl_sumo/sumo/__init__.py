"""All calls of SUMO's API; only this folder imports libsumo. Modules of other folders pass a SumoApi to it."""
