"""From an image to points on the planet's limb: candidates, selection, refinement."""
