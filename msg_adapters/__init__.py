"""ROS messages <-> NumPy. The only code that touches message fields."""
