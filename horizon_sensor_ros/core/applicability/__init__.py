"""Where on a sphere of attitudes cameras see the horizon, and how well it tells nadir there.

``visibility`` (what is in the frames), ``error_map`` (the error to be expected), ``section_circle``
(paper A's approximation, to compare with).
"""
