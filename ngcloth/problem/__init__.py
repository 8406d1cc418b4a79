"""What the user says: surface, fabric, limits, scene; and the words for it, `Kinematics`.

Lives on expressions alone: checks what it is given, makes no mesh and computes no answer.
Knows no other room.
"""
