"""What an edge looks like across the limb, and where in a profile it lies."""
