"""Rotations, and statistics and matrices of few numbers.

``attitude`` (quaternions, roll and pitch, the level frame), ``rigid`` (motions), ``columns``
(products of many vectors), ``robust`` (order statistics), ``parts`` (of arrays), ``normal_law``,
``odds``, ``symmetric3`` (matrices).
"""
