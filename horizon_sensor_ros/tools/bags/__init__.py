"""Bags in and out: `horizon_replay`, `horizon_bag_from_images`, `horizon_bag_to_csv`.

Commands and what they do: ``replay`` with ``bag_replay``, ``replayed_node`` and ``replay_tally``;
``bag_from_images`` with ``frame_recording``, ``frame_files`` and ``cloud_files``; ``bag_to_csv``
with ``bag_tables`` and ``message_tables``. Bags: ``input_bag``, ``bag_listening``, ``output_bag``,
``compressed_images``, ``topic_advice``, ``unreadable``.
"""
