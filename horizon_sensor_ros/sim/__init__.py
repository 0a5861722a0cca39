"""Simulators with exact truth: the Earth camera, a flight around the planet, the range camera."""
