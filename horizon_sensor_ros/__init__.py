"""Onboard attitude sensing for ROS 2: local vertical from the horizon, motion of an unknown target.

``core`` (the algorithms), ``ros`` (nodes around them), ``tools`` (command lines), ``sim`` (scenes
with truth). Imports go one way: tools -> ros -> core, and tools -> sim -> core.
"""
