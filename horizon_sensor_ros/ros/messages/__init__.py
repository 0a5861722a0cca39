"""Messages to numpy, and numpy to messages.

Read: ``stamps``, ``images``, ``point_cloud`` and its ``point_times`` (of their ``data_bytes``),
``camera_info``, ``aiding`` (coarse poses, rates), of their fields ``geometry``.
Written: ``estimates``, and what ``sensors`` send, for whoever plays one. Names: ``message_types``.

Reading is duck-typed: it takes rclpy's messages and those that `rosbags` reads alike. What cannot
be used comes back as a ``refusal``, never as an exception: a message is data.
"""
