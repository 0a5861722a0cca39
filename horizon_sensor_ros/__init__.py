"""Onboard attitude sensing for ROS 2: local vertical from the horizon, motion of an unknown
target.
"""
