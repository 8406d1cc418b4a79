"""The patch belongs to the surface, whatever chart describes it."""

from dataclasses import replace

import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import gp_GTrsf
from scipy.linalg import orthogonal_procrustes

from ngcloth import Disk, Elongation, Net, Rectangle, Scene, Surface, solve
from ngcloth.energy.closed_form import ClosedFormLagrangian
from ngcloth.problem.kinematics import gradient
from ngcloth.result.history import Reason
from ngcloth.solver.interior_point import interior_point
from ngcloth.solver.meshes import make_sheets
from ngcloth.solver.recorder import Recorder

FABRIC = Net(ks=3.0)
HEIGHT = 0.3  # of the cap over the plane of its rim, whose radius is one
RADIUS = (1 + HEIGHT**2) / (2 * HEIGHT)


def conformal(x, y):
    """Stereographic projection from the pole opposite to the cap."""
    square = HEIGHT**2 * (x * x + y * y)
    scale = 2 * RADIUS / (1 + square)
    return HEIGHT * x * scale, HEIGHT * y * scale, scale


def height_field(x, y):
    return x, y, ngs.sqrt(RADIUS**2 - x * x - y * y)


def dome(x, y):
    return x, y, -0.5 * x * x - 0.2 * y * y


def uneven(x, y):
    """Coordinates of the dome that are stretched along one axis and sheared."""
    return x - 0.2 * y, 0.5 * y


class Askew(Disk):
    """What `uneven` maps to the disk: an ellipse."""

    box = ((-1.2, 1.2), (-2.0, 2.0))

    def contains(self, theta, tolerance=1e-9):
        x, y = theta[..., 0] - 0.2 * theta[..., 1], 0.5 * theta[..., 1]
        return np.hypot(x, y) <= 1 + tolerance

    def rim(self, n):
        x, y = super().rim(n).T
        return np.stack([x + 0.4 * y, 2 * y], axis=-1)

    def _shape(self):
        stretch = gp_GTrsf([1, 0.4, 0, 0, 2, 0, 0, 0, 1])
        return stretch(super()._shape())


def flattened(chart, domain, start=lambda x, y: (0.9 * x, 0.85 * y), maxh=0.2):
    scene = Scene(Surface(chart, domain), FABRIC, [Elongation()], start=start)
    return solve(scene, maxh=maxh, order=4, barrier_end=1e-5)


def assert_same_patch(one, other):
    """Up to a translation and a rotation, which are free."""
    assert one.converged and other.converged and one.extrema["stretch1"][1] > 1.04
    assert other.normalized_energy == pytest.approx(one.normalized_energy, abs=1e-5)
    here, there = (patch.outline(40) - patch.outline(40).mean(axis=0) for patch in (one, other))
    turned, _ = orthogonal_procrustes(there, here)
    assert there @ turned == pytest.approx(here, abs=1e-4)


def test_conformal_chart_and_height_field():
    assert_same_patch(flattened(conformal, Disk()), flattened(height_field, Disk()))


def test_sheared_and_stretched_chart():
    other = flattened(
        lambda x, y: dome(*uneven(x, y)),
        Askew(),
        start=lambda x, y: (0.9 * (x - 0.2 * y), 0.85 * 0.5 * y),
        maxh=0.25,
    )
    assert_same_patch(flattened(dome, Disk(), maxh=0.15), other)


def broken_metric(smooth, theta):
    """Of a surface in parameters θ' that a continuous map θ(θ'), a GridFunction, breaks."""
    position = ngs.CF(tuple(smooth.chart(*theta.components)))
    tangents = [position.Diff(each) for each in theta.components]
    products = [ngs.InnerProduct(a, b) for a in tangents for b in tangents]
    slopes = gradient(*theta.components)
    return slopes.trans * ngs.CF(tuple(products), dims=(2, 2)) * slopes


def broken_mesh(mesh):
    """The mesh with its inner vertices moved, and the affine maps of its triangles back."""
    rim = {vertex.nr for edge in mesh.Boundaries("rim").Elements() for vertex in edge.vertices}
    moved, random = mesh.ngmesh.Copy(), np.random.default_rng(2)
    before = moved.Coordinates().copy()
    for number, point in enumerate(moved.Points()):
        if number not in rim:
            for axis, shift in enumerate(random.uniform(-0.1, 0.1, 2)):
                point[axis] += shift
    moved = ngs.Mesh(moved)
    theta = ngs.GridFunction(ngs.H1(moved, order=1) ** 2)
    for component, values in zip(theta.components, before.T, strict=True):
        component.vec.FV().NumPy()[:] = values
    return moved, theta


def test_chart_that_is_smooth_only_inside_triangles():
    """θ → θ' is affine in each triangle and follows its edges: on the mesh nothing is different.

    With the derivatives of the metric that equilibrium has in curvilinear coordinates, patches of
    such charts differ by a fifth.
    """
    scene = Scene(Surface(dome, Rectangle((-1, 1), (-0.8, 0.8))), FABRIC, [Elongation()])
    *_, sheet = make_sheets(scene, 0.45, 1)
    mesh = sheet.mesh
    moved, theta = broken_mesh(mesh)
    assert np.abs(moved.ngmesh.Coordinates() - mesh.ngmesh.Coordinates()).max() > 0.05
    problems = [ClosedFormLagrangian(scene, sheet, 2, 6, "sparsecholesky", 2)]
    broken = replace(sheet, mesh=moved, metric=broken_metric(scene.surface, theta))
    problems.append(ClosedFormLagrangian(scene, broken, 2, 6, "sparsecholesky", 2))
    problems[1].unknowns[:] = problems[0].unknowns
    for problem in problems:
        recorder = Recorder(1.0, 60, None)
        assert interior_point(problem, recorder, 1e-4) is Reason.CONVERGED
    smooth, other = problems
    assert smooth.imbalance() < 1e-3 * smooth.cost() and smooth.cost() > 0.01
    assert other.cost() == pytest.approx(smooth.cost(), rel=1e-6)
    assert other.unknowns == pytest.approx(smooth.unknowns, abs=1e-4)
