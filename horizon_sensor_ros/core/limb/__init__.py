"""From an image to points on the planet's limb: candidates, selection, refinement.

``detector`` runs all of it over simultaneous frames and returns a ``detection``: ``search`` finds
the limb to a few pixels, ``passes`` narrow it down, each by ``refinement`` of one frame, which
looks at a ``sample`` of it (``profiles`` across the limb; ``sized_frame``: in which size) and
either places edges one by one (``edge_by_edge``) or fits limb and glow together. What the limb may
look like: ``edge`` (sharp, smeared, saturated), ``texture`` (clouds beside it), ``glow`` (above it;
``air``: of what glows), ``haze`` (air that hides the ground), ``smeared`` (by motion),
``lens_kinds`` (lenses that blur and darken).

Before all of it ``sun_streak`` takes the Sun's streaks off a frame. What speaks against a limb:
``evidence``, ``sun_artefact``, ``strip`` (parts of the craft). ``canny_limbs`` are the papers', for
comparison.
"""
