"""The command line tools.

``bags`` (replay, bags from images, tables from bags), ``calibration`` (how the cameras sit),
``applicability`` (where a mounting sees the horizon), ``demo`` (a flight past the nodes),
``report`` (a bag as one page), ``truth`` (answers held against a simulation's). What they share
lies beside them.
"""
