#!/usr/bin/env bash
# NGSolve 6.2.2608: second derivatives of a GridFunction on H1(mesh, dim=3) have the shape of those
# of a scalar, (2, 2), in place of (3, 2, 2), though the first derivatives are (3, 2). A product of
# three scalar spaces gives all of them, by component.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q ngsolve==6.2.2608 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import ngsolve as ngs

mesh = ngs.Mesh(ngs.unit_square.GenerateMesh(maxh=0.5))
vector = ngs.GridFunction(ngs.H1(mesh, order=3, dim=3))
vector.Set(ngs.CF((ngs.x**2, ngs.x * ngs.y, ngs.y**3)))
print("Grad:", tuple(ngs.Grad(vector).dims), "hesse:", tuple(vector.Operator("hesse").dims))
assert tuple(ngs.Grad(vector).dims) == (3, 2)
assert tuple(vector.Operator("hesse").dims) == (2, 2)
parts = ngs.GridFunction(ngs.H1(mesh, order=3) ** 3)
for part, value in zip(parts.components, (ngs.x**2, ngs.x * ngs.y, ngs.y**3), strict=True):
    part.Set(value)
third = parts.components[2].Operator("hesse")(mesh(0.3, 0.4))
print("of the third component at y = 0.4:", [round(entry, 9) for entry in third])
assert abs(third[3] - 6 * 0.4) < 1e-9
PYTHON
