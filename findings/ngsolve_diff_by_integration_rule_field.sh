#!/usr/bin/env bash
# NGSolve 6.2.2608: an expression can be differentiated by a GridFunction of an IntegrationRuleSpace
# where it is made of products and square roots, but not where it holds a BSpline or a power: Diff
# works, and the derivative raises when it is evaluated or compiled, with a message about an operator
# of that space. By 1.0 * field in place of the field both work, and the values are right.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q ngsolve==6.2.2608 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import ngsolve as ngs
from ngsolve.comp import IntegrationRuleSpace

mesh = ngs.Mesh(ngs.unit_square.GenerateMesh(maxh=0.5))
space = IntegrationRuleSpace(mesh, order=2)
field, sample = ngs.GridFunction(space), ngs.GridFunction(space)
field.vec[:] = 0.5
spline = ngs.BSpline(4, [0, 0, 0, 0, 1, 1, 1, 1], [0, 1, 0, 2])


def derivative(law, variable):
    try:
        sample.Interpolate(law(variable).Diff(variable).Compile())
    except Exception as error:
        return f"{type(error).__name__}: {str(error).splitlines()[0]}"
    return f"{sample.vec[0]:.6f}"


laws = {"x * x": lambda x: x * x, "BSpline": spline, "x**2.5": lambda x: x**2.5}
found = {name: (derivative(law, field), derivative(law, 1.0 * field)) for name, law in laws.items()}
for name, pair in found.items():
    print(f"{name:8s} by the field: {pair[0]}\n         by 1.0 * field: {pair[1]}")
assert found["x * x"] == ("1.000000", "1.000000")
for name in ("BSpline", "x**2.5"):
    by_field, by_product = found[name]
    assert "not overloaded" in by_field, by_field
    assert abs(float(by_product) - {"BSpline": 0.75, "x**2.5": 2.5 * 0.5**1.5}[name]) < 1e-3
PYTHON
