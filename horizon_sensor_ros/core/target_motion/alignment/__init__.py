"""The motion that lays one view of the target on another, and how well it is known.

``attempts`` drive it: ``search`` (many motions at once, coarsely), then one of them to the sensor's
noise: ``matcher`` (which surfaces and edges of both views go together), ``pairs`` (what it finds),
``refinement``. What tells motions apart: ``consistency`` (would each view have seen what the other
one saw) and ``uncertainty``, with what ``relief`` adds to it.
"""
