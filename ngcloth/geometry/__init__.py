"""What a file needs to become a surface: reading, orientation, flattening, curvature.

Lies beside `problem`: knows its words, and no mesh of a solve.
"""
