"""What a file needs to become a surface: reading, orientation, flattening, curvature.

Knows no other room: it gives charts on planar meshes, and the rooms above make scenes of them.
"""
