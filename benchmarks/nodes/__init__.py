"""Of running nodes, in processes of their own.

``target_latency``, the part of that name, is of target_pose_node. For the commands one folder up:
``rig`` (two cameras that see the horizon), ``start_up`` (time from exec to active).
"""
