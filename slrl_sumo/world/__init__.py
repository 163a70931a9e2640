"""Plain arrays and geometry: what a traffic scene is, without any simulator."""
