"""What a person takes away: pictures, the report, cut patterns, fields for other programs.

Each takes a result as it is, and asks it for numbers; plotting libraries are imported where used.
May know the problem.
"""
