"""The nodes: a callback is decode, core, encode.

Images: ``horizon_node``, with ``image_feed`` (subscriptions) and ``extrinsics`` (rotations from
TF). Clouds: ``target_node``.

Every node: ``managed_node`` (lifecycle, parameters), ``parameter_requests``, ``sim_time``, ``qos``,
``reporting_node`` (outputs, diagnostics).
"""
