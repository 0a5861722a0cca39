"""The motion that lays one view of the target on another, and how well it is known.

``attempts`` drive it: ``search`` (many motions at once, coarsely), ``pairs`` and ``refinement``
(one of them, to the sensor's noise). What tells them apart: ``consistency`` (would each view have
seen what the other one saw) and ``uncertainty``.
"""
