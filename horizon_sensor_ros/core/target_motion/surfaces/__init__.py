"""What surfaces a range image shows; ``surface_view`` has all of it, as one view of the target.

``planes`` (one at each pixel): ``windows`` (fits in them), ``holes`` (in spite of lone missing
returns), ``sag`` (by which curved surfaces lead them), ``body_limb`` (where they are not to be
trusted), ``fading_limb`` (where the sensor loses them), ``covered`` (pixels that the surface covers
in part); those of thin ``parts``; ``edges`` (where surfaces end or meet); ``surfels`` (a selection
of planes, and bare returns).
"""
