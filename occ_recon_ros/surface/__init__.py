"""Rims to triangles to files."""
