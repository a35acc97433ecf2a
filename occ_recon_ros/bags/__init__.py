"""rosbag2 and image folders: read, write, salvage, choose topics. No rclpy."""
