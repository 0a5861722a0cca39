"""ROS 2 around the core: messages in, messages out.

``messages``: to numpy, and of it. An image: ``image_feed`` (subscriptions), ``horizon_node``
(decode, core, encode), ``horizon_pipeline`` (``pairing``, ``aiding_sources`` with
``coarse_poses``, ``extrinsics``, the core), ``horizon_outputs``; and ``debug_image`` on a
``canvas``. A cloud: ``target_node``, ``target_pipeline``. The pipelines know no node: replays run
them too.

Every node: ``managed_node`` (lifecycle, ``parameters``), ``parameter_requests``, ``sim_time``,
``reporting_node``, ``state_log``, ``diagnostics`` (with ``horizon_diagnostics``, ``own_counts`` and
``target_diagnostics``), ``qos``.
Processes: ``executable``, ``interruption``, ``closed_streams``, ``participant_end``,
``node_names``, and the executables ``local_vertical_node``, ``attitude_node``, ``target_pose_node``
and, all in one, ``horizon_sensor``. Files: ``yaml_file``, ``resources`` (named by parameters).
"""
