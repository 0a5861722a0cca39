"""The nodes' processes: how they start and end.

``executable`` (from the first line to the exit code), ``interruption`` (what a signal breaks off),
``closed_streams``, ``participant_end`` (of the DDS graph), ``defect`` (what is told of one),
``node_names``.

These are light, and so is this folder: they are loaded before everything that takes time. Not by
them, but by the launch files: ``launch_parts``.
"""
