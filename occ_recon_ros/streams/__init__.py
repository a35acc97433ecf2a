"""What nodes use without ROS: pairing, order of a scan, checkpoints, statistics."""
