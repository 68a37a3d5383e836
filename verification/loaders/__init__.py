"""Exported data sets, loaded by the projects whose formats they are in.

What runs beside those projects' packages needs only numpy, h5py and OpenCV of its own, and shares
no code with the exporter: it reads the collected episodes by itself.
"""
