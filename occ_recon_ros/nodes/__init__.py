"""ROS 2 nodes: parameters, topics, services and diagnostics around the packages beside it."""
