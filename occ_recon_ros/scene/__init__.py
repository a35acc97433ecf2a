"""Virtual turntable: analytic objects with exact rims, rendered to images."""
