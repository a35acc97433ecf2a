"""How good a surface is: silhouettes, distances, the true surface. No ROS."""
