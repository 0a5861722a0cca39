"""ROS 2 around the core: messages in, messages out.

An image or a cloud: ``nodes`` (decode, core, encode) hand it to ``pipelines``, which know no node,
so that replays run them too; these read and write ``messages``. What nodes say of themselves is
``diagnostics``; what they draw, ``pictures``. What is set: ``parameters``, and the ``files`` that
people write.

Executables: ``local_vertical_node``, ``attitude_node``, ``target_pose_node`` and, all in one,
``horizon_sensor``. How they start and end: ``process``.
"""
