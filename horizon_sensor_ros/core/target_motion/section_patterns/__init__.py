"""Paper D's method, for comparison: patterns of a cloud's sections, searched for the likest.

``inertia_frame`` (in which the planes lie), ``section_pattern`` (patterns, and how alike two are),
``candidate`` (motions as the paper tells them), ``objective`` (how alike one makes two clouds),
``direct_search`` (the maximum).
"""
