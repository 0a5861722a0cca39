"""A point cloud as an image of inverse depth.

``crop`` leaves of a cloud what is in a box; ``cropped``: what that took away tells of the target.
``range_image`` makes the image of any, by way of: ``own_frame`` (where the sensor of a cloud in
another frame is), ``grid`` (which pixel a point is of; ``regular``: whether values lie on a grid),
``pixel_values`` (one inverse depth for each pixel), ``field_of_view`` (beyond which nothing was
looked at), ``range_step`` (whether ranges come in whole steps). ``nearest``: which of some pixels
is.
"""
