"""Problems on a mesh for tests: a state, and its numbers."""

import ngsolve as ngs
import numpy as np

from ngcloth import Disk, Elongation, Net, Scene, ShearLimit, Surface
from ngcloth.energy.closed_form import ClosedFormLagrangian
from ngcloth.scenes import hemicatenoid, sphere
from ngcloth.solver.meshes import make_sheets


def discretised(scene, maxh=0.4, order=2, quadrature=None, kind=ClosedFormLagrangian):
    quadrature = 2 * order + 2 if quadrature is None else quadrature
    *_, sheet = make_sheets(scene, maxh, order)
    return kind(scene, sheet, order, quadrature, "umfpack", order)


def vector(problem):
    """The coefficients of the state, a NumPy view to read and write."""
    return problem.state.vec.FV().NumPy()


def derivative(problem, z):
    out = problem.state.vec.CreateVector()
    problem.gradient(z, out)
    return out.FV().NumPy().copy()


def times(matrix, direction):
    given, out = matrix.CreateColVector(), matrix.CreateColVector()
    given.FV().NumPy()[:] = direction
    out.data = matrix * given
    return out.FV().NumPy().copy()


def skew_surface(domain=None):
    def chart(t1, t2):
        return t1 + 0.2 * t1 * t2, 1.1 * t2 + 0.1 * t1, 0.3 * t1 * t1 + 0.2 * ngs.sin(t2)

    return Surface(chart, domain or Disk(1))


def bent(x, y):
    return 0.55 * x + 0.06 * x * y * y, 0.5 * y + 0.07 * y * x * x


TAYLOR = {
    "sphere": lambda: Scene(
        sphere(0.6).surface, Net(ks=2.0), (Elongation(), ShearLimit(0.9)), bent, symmetric=True
    ),
    "skew chart": lambda: Scene(
        skew_surface(), Net(kc=(2.0, 0.5), ks=0.3), (Elongation(), ShearLimit(0.8)), start=bent
    ),
    "obstacle": lambda: hemicatenoid(10.0, obstacle=True),
}


def with_multipliers(problem, seed=5):
    """Put a v ≠ 0 into the state, and return a direction in all free unknowns."""
    random = np.random.default_rng(seed)
    free = np.array(list(problem.free))
    state = vector(problem)
    size = 0.1 * np.abs(state).max()
    v = slice(problem.psi_dofs.stop, None)
    state[v] = size * random.uniform(-1, 1, len(state))[v] * free[v]
    return size * random.uniform(-1, 1, len(state)) * free


def assert_strictly_feasible(result):
    settings = result.settings
    problem = ClosedFormLagrangian(
        result.scene,
        result.sheet,
        settings["order"],
        settings["quadrature"],
        settings["inverse"],
        settings["multiplier_order"],
    )
    vector(problem)[:] = result.state.vec.FV().NumPy()
    assert problem.least_jacobian() > 0
    assert problem.slacks().min() > 0


def assert_solved(result, slack=1e-2, shear=1.0, steps=60):
    """Converged swiftly, not folded, and feasible between the sampling points up to `slack`."""
    assert result.converged and result.newton_iterations <= steps
    extrema = result.extrema
    assert extrema["jacobian"][0] > 0
    assert min(extrema["stretch1"][0], extrema["stretch2"][0]) >= 1 - slack
    assert max(np.abs(extrema["shear"])) <= shear + 1e-2
