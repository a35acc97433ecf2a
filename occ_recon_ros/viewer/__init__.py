"""What the page of a running scan shows, and of which messages. No ROS."""
