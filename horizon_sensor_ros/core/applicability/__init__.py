"""Where on a sphere of attitudes cameras see the horizon, and how well it tells nadir there."""
