"""The algorithms: numpy, scipy and OpenCV only, nothing of ROS.

Data flows one way: ``camera`` (pixels to rays), ``limb`` (image to limb points), ``fits`` (limb
points to nadir and altitude), ``horizon_sensor`` (the whole chain over N cameras).
"""
