"""Load exported data sets with the loaders of the projects that define the formats.

The checks that run in those projects' environments need only numpy, h5py and OpenCV besides. They
read the collected episodes on their own and share no code with the exporter.
"""
