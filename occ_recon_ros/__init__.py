"""Streaming 3D surface reconstruction from occluding contours.

E. Boyer and M.-O. Berger, "3D Surface Reconstruction Using Occluding
Contours", IJCV 22(3):219-233, 1997, https://doi.org/10.1023/A:1007997617239
"""
