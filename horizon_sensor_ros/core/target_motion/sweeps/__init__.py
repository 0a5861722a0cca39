"""Clouds that took time: what the target's motion meanwhile did to them is taken out.

``sweep`` (points and their times), ``velocity`` (of the target), ``stilled_image`` (where the
points lie on the sensor's own grid).
"""
