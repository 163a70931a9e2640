"""Flow of traffic: learned road users beside SUMO's own in situations that traffic engineering measures."""
