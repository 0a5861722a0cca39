"""Rotations, and statistics and matrices of few numbers.

``attitude`` (quaternions, roll and pitch, the level frame), ``rigid`` (motions), ``robust`` (order
statistics), ``symmetric3`` (matrices).
"""
