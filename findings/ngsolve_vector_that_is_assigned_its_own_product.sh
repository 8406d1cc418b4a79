#!/usr/bin/env bash
# NGSolve 6.2.2608: x.data = A * x sets x to zero, without a word, where A is a sparse matrix: the
# target is cleared before it is read. So does the inverse by "sparsecholesky"; that by "umfpack"
# and a Projector give the product, so that a line that works with one of them fails with another.
# x.data += A * x is wrong by a few per cent, since rows that come later see what was added before:
# an error that looks like one of discretisation. (A * x).Evaluate() takes a vector of its own.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q ngsolve==6.2.2608 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import ngsolve as ngs

mesh = ngs.Mesh(ngs.unit_square.GenerateMesh(maxh=0.5))
space = ngs.H1(mesh, order=1)
u, v = space.TnT()
mass = ngs.BilinearForm(u * v * ngs.dx).Assemble().mat
every = ngs.BitArray(space.ndof)
every.Set()
operators = {
    "matrix": mass,
    "sparsecholesky": mass.Inverse(inverse="sparsecholesky"),
    "umfpack": mass.Inverse(inverse="umfpack"),
    "Projector": ngs.Projector(every, True),
}
ones = mass.CreateColVector()
ones[:] = 1
sizes = {}
for name, operator in operators.items():
    apart, own = ones.CreateVector(), ones.CreateVector()
    apart.data, own.data = operator * ones, ones
    own.data = operator * own
    sizes[name] = apart.Norm(), own.Norm()
    print(f"{name}: |A x| = {sizes[name][0]:.6f}, |x| after x.data = A * x: {sizes[name][1]:.6f}")
added, right = ones.CreateVector(), ones.CreateVector()
added.data = ones
added.data += mass * added
right.data = ones + mass * ones
print(f"|x + A x| = {right.Norm():.6f}, |x| after x.data += A * x: {added.Norm():.6f}")
for name in ("matrix", "sparsecholesky"):
    assert sizes[name][0] > 0 and sizes[name][1] == 0, name
for name in ("umfpack", "Projector"):
    assert abs(sizes[name][0] - sizes[name][1]) < 1e-9 * sizes[name][0], name
assert 1e-3 < abs(added.Norm() / right.Norm() - 1) < 0.1
PYTHON
