"""Pixels to occluding contours (OpenCV)."""
