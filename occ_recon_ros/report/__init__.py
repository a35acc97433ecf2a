"""Results for people: numbers, pictures, one page. No ROS."""
