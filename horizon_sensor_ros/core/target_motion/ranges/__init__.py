"""A point cloud as an image of inverse depth.

``range_image`` makes it of any cloud; ``regular`` (whether values lie on a grid), ``pixel_values``
(one inverse depth for each pixel).
"""
