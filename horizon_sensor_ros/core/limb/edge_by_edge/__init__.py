"""The limb of edges that are found one by one along it, and what they are off by together.

``limb`` makes a limb of such ``edges``, those of the steepest falls or ``modelled`` ones, which a
model places and, where they are sharp, kriging about a ``kriged_limb``. ``followed`` is the short
way to a limb that is where it was expected. ``light`` is what edges need where it ends, falls
inwards or is too bright; ``points`` are what is handed on.
"""
