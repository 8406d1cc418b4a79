"""Is the pinned cloth in equilibrium? Asked with richer test functions than the solver's."""

import ngsolve as ngs
import numpy as np

from ..problem.kinematics import Kinematics, gradient


def equilibrium_residual(result):
    """The force on the cloth inside the rim over that with the rim included, in a dual norm.

    Parameters
    ----------
    result : Result
        Converged or not.

    Returns
    -------
    float
        See `Result.equilibrium_residual`.
    """
    inside, whole = forces(result)
    floor = 1e-9 * np.sqrt(result.area / result.scene.copies)
    return float(inside / max(whole, floor))


def forces(result):
    """Dual norms of the force over kc, on the cloth inside the rim and with the rim included."""
    scene, mesh = result.scene, result.state.space.mesh
    metric, order = result.sheet.metric, result.settings["order"] + 1
    mirrors = ["mirror1", "mirror2"] if scene.symmetric else ["", ""]
    space = ngs.FESpace([ngs.H1(mesh, order=order, dirichlet=line) for line in mirrors])
    v, rule = space.TestFunction(), ngs.dx(bonus_intorder=2 * order)
    slope = gradient(*result.state.components[:2])
    cloth = Kinematics(slope, metric)
    energy = cloth.jacobian * scene.fabric.energy(cloth.I4, cloth.I6, cloth.I8)
    force, area = ngs.LinearForm(space), ngs.sqrt(ngs.Det(metric))
    force += (energy.Diff(slope, gradient(*v)) / scene.fabric.stiffness).Compile() * rule
    whole = ngs.Integrate(area * rule, mesh)
    norm = ngs.BilinearForm(space, symmetric=True)
    for u, w in zip(*space.TnT(), strict=True):
        weight = ngs.Cof(metric) / area
        norm += ((weight * ngs.grad(u)) * ngs.grad(w) + 1e-2 * area / whole * u * w) * rule
    force.Assemble(), norm.Assemble()

    def dual_norm(free):
        riesz = norm.mat.Inverse(free, inverse="sparsecholesky") * force.vec
        return np.sqrt(max(ngs.InnerProduct(force.vec, riesz.Evaluate()), 0.0))

    inside = ngs.BitArray(space.FreeDofs())
    for i, component in enumerate(space.components):
        on_rim = component.GetDofs(mesh.Boundaries("rim"))
        for dof in np.flatnonzero(list(on_rim)):
            inside.Clear(space.Range(i).start + int(dof))
    return dual_norm(inside), dual_norm(space.FreeDofs())
