"""ROS 2 around the core: messages in, messages out."""
