"""Parts to be read back: CAD by netgen.occ, facets by formula."""

import numpy as np
from netgen.occ import ArcOfCircle, Axis, Box, MoveTo, Pnt, Segment, Sphere, Wire, Z


def hemisphere():
    half = Sphere(Pnt(0, 0, 0), 1) - Box(Pnt(-2, -2, -2), Pnt(2, 2, 0))
    half.faces.Max(Z).name = "dome"
    return half


def octant():
    part = Sphere(Pnt(0, 0, 0), 1) * Box(Pnt(0, 0, 0), Pnt(2, 2, 2))
    dome = max(part.faces, key=lambda face: face.mass)
    dome.name = "dome"
    for edge in dome.edges:
        if abs(edge.center[0]) < 1e-9:
            edge.name = "mirror1"
        elif abs(edge.center[1]) < 1e-9:
            edge.name = "mirror2"
    return part


def hat(slope=np.pi / 4, fillet=0.3, flange=0.4):
    """A dome of radius 1, a fillet and a flat flange, three faces that join smoothly.

    Returns the shape, its area, and the least radius of curvature.
    """
    sine, cosine = np.sin(slope), np.cos(slope)
    r1, z1 = sine, cosine  # where the dome ends
    centre = np.array([r1 + fillet * sine, z1 + fillet * cosine])
    r2, z2 = centre[0], centre[1] - fillet
    middle = centre - fillet * np.array([np.sin(slope / 2), np.cos(slope / 2)])
    top = np.array([np.sin(slope / 2), np.cos(slope / 2)])
    at = [Pnt(r, 0, z) for r, z in ((0, 1), top, (r1, z1), middle, (r2, z2), (r2 + flange, z2))]
    profile = Wire([ArcOfCircle(*at[:3]), ArcOfCircle(*at[2:5]), Segment(at[4], at[5])])
    part = profile.Revolve(Axis((0, 0, 0), Z), 360)
    dome = 2 * np.pi * (1 - cosine)
    torus = 2 * np.pi * fillet * (centre[0] * slope - fillet * (1 - cosine))
    return part, dome + torus + np.pi * ((r2 + flange) ** 2 - r2**2), fillet


def double_dome():
    """Two domes that run into each other on a flange, all edges but those of the plate rounded."""
    domes = Sphere(Pnt(-0.6, 0, -0.4), 1) + Sphere(Pnt(0.6, 0, -0.4), 1)
    solid = Box(Pnt(-2, -1.5, -0.3), Pnt(2, 1.5, 0)) + domes * Box(Pnt(-3, -3, 0), Pnt(3, 3, 2))
    valley = [edge for edge in solid.edges if edge.center[2] > 0.1 and abs(edge.center[0]) < 0.01]
    solid = solid.MakeFillet(valley, 0.3)
    middles = np.array([tuple(edge.center) for edge in solid.edges])
    foot = np.all(np.abs(middles) < [1.95, 1.45, 0.02], axis=1)
    return solid.MakeFillet([e for e, near in zip(solid.edges, foot, strict=True) if near], 0.2)


def panel_with_hole():
    return MoveTo(0, 0).Rectangle(3, 2).Face() - MoveTo(1, 1).Circle(0.4).Face()


def facets(rings, noise=0.0, hole=0):
    """A unit hemisphere, or without its `hole` first rings, on which vertices lie irregularly."""
    random = np.random.default_rng(1)
    points, around, triangles = [(0.0, 0.0, 1.0)], [[0]], []
    for i in range(1, rings + 1):
        off = 0.25 * (random.random((6 * i, 2)) - 0.5)
        polar = np.pi / 2 * (i + off[:, 0] * (i < rings)) / rings
        angle = 2 * np.pi * (np.arange(6 * i) + off[:, 1]) / (6 * i)
        around.append(list(range(len(points), len(points) + 6 * i)))
        points += zip(
            np.sin(polar) * np.cos(angle), np.sin(polar) * np.sin(angle), np.cos(polar), strict=True
        )
        inner, outer = around[-2:]
        for j in range(6 * i):
            here = (j // i) * (i - 1) + j % i
            a, b, c = inner[here % len(inner)], outer[j], outer[(j + 1) % (6 * i)]
            triangles.append((a, b, c))
            if j % i < i - 1:
                triangles.append((a, c, inner[(here + 1) % len(inner)]))
    points = np.array(points) * (1 + noise * random.standard_normal(len(points)))[:, None]
    return points, np.array(triangles[6 * hole**2 :])


def tube(height, top=1.0, n=60, m=20):
    z, angle = np.linspace(0, height, m + 1), 2 * np.pi * np.arange(n) / n
    radius = 1 + (top - 1) * z / height
    points = np.stack(
        [
            np.outer(radius, np.cos(angle)),
            np.outer(radius, np.sin(angle)),
            np.outer(z, 0 * angle + 1),
        ],
        axis=-1,
    )
    i, j = np.meshgrid(range(m), range(n), indexing="ij")
    a, b = i * n + j, i * n + (j + 1) % n
    triangles = [np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, b + n), (a, b + n, a + n))]
    return points.reshape(-1, 3), np.concatenate(triangles)


def write_iges(path):
    """Half of a cylinder of radius 1 and height 2, in two NURBS surfaces that share nothing.

    Written by hand, as no kernel here does.
    """
    header = (
        "1H,,1H;,4Hpart,8Hpart.igs,4Htest,1H1,32,38,6,308,15,4Hpart,1.0,2,2HMM,1,0.01,"
        "15H20240101.000000,1E-7,10.0,4Hnone,4Hnone,11,0,15H20240101.000000;"
    )
    sections = {"S": ["half of a cylinder"], "G": [header[:72], header[72:]], "D": [], "P": []}
    for number, turn in enumerate((0, np.pi / 2)):
        c, s = np.cos(turn), np.sin(turn)
        arc = [(c * x - s * y, s * x + c * y) for x, y in ((1, 0), (1, 1), (0, 1))]
        poles = [coordinate for z in (0, 2) for x, y in arc for coordinate in (x, y, z)]
        knots, weights = [0, 0, 0, 1, 1, 1, 0, 0, 1, 1], [1, 0.5**0.5, 1] * 2
        numbers = [*knots, *weights, *poles, 0, 1, 0, 1]
        data = "128,2,1,2,1,0,0,0,0,0," + ",".join(repr(float(n)) for n in numbers) + ";"
        first = len(sections["P"]) + 1
        while data:
            cut = len(data) if len(data) <= 64 else data[:64].rindex(",") + 1
            sections["P"].append(f"{data[:cut]:<64}{2 * number + 1:8d}")
            data = data[cut:]
        lines = len(sections["P"]) + 1 - first
        sections["D"] += [
            f"{128:8d}{first:8d}" + f"{0:8d}" * 6 + "00000000",
            f"{128:8d}{0:8d}{0:8d}{lines:8d}{0:8d}" + " " * 24 + f"{0:8d}",
        ]
    rows = [
        f"{text:<72}{letter}{row:7d}"
        for letter, texts in sections.items()
        for row, text in enumerate(texts, start=1)
    ]
    counts = "".join(f"{letter}{len(texts):7d}" for letter, texts in sections.items())
    path.write_text("\n".join([*rows, f"{counts:<72}T{1:7d}"]) + "\n")
