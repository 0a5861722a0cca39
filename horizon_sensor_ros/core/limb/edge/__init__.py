"""What an edge looks like across the limb, and where in a profile it lies.

``steepest`` (without a model), ``model`` (of an edge), ``looks`` (which one fits), ``places``
(where it then lies), ``near_edge`` (how bright the planet is there). What blurs or bends it:
``lens_blur``, ``raster``, ``smear`` (by what the edges say), ``told_smear`` (by exposure and rate),
``width`` (by how wide the edge is), ``darkening`` (ground that darkens towards it). Where gray
levels end: ``black``, ``clipping``, ``demosaicing`` (colours that were clipped before gray); where
light does: ``terminator``.
"""
