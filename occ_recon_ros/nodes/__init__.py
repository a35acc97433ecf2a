"""Thin rclpy shells around the parts: topics, parameters, services, diagnostics."""
