"""How it is minimised: `solve`, the loops it chooses from, linear systems, starts, checkpoints.

Loops know no surface and no fabric, only the Lagrangian they are given.
May know all other rooms.
"""
