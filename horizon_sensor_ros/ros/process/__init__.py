"""The nodes' processes: how they start and end.

``executable`` (from the first line to the exit code), ``interruption`` (what a signal breaks off),
``closed_streams``, ``participant_end`` (of the DDS graph), ``defect`` (what is told of one),
``node_names``.

All of it is light, and so is this folder: it is loaded before everything that takes time.
"""
