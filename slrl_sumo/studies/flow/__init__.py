"""Flow of traffic: learned road users compared with SUMO's models in situations of traffic engineering."""
