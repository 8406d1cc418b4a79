"""What is minimised, on a mesh: the Lagrangian and its derivatives at sampling points.

Has no loop in it: it tells value, forces and matrix at the ψ it is given.
May know the problem.
"""
