"""An off-the-shelf solver on the same discrete problem: IPOPT, through casadi.

A constrained scene on a mesh is a nonlinear program,

    minimise    E(ψ) = Σ w J W                  over the free degrees of freedom of ψ
    subject to  dE(ψ)[v] = 0                    for every free basis function v
                c(θ_q) ≥ 0                      for every slack c at every point of ngcloth's:
                                                those of its rules, and any that its solve added.

Here IPOPT solves it, from the scene's start on ngcloth's mesh, spaces and points: exact first and
second derivatives, adaptive barrier, kernels in compiled C where there is a compiler.

IPOPT's barrier weighs all slacks alike, ngcloth's by area and length. So IPOPT goes to the optimum,
ngcloth as near to it as `barrier_end` says; energies further apart are different local minima.
"Arrival" is when IPOPT comes within 1e-4 of its last energy and of feasibility, to stay. Seconds
are processor time of one thread; mesh and setup count for ngcloth, and for IPOPT are listed apart.

    python demos/ipopt_peer.py            # a minute; needs the extra `bench`; prints a table
"""

import functools
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

import ngcloth
from ngcloth.energy.closed_form import ClosedFormLagrangian
from ngcloth.energy.sampling import AddedPoints, RimPoints, Sampling
from ngcloth.errors import InputError
from ngcloth.result.history import Reason
from ngcloth.result.result import Result
from ngcloth.solver.meshes import make_sheets
from ngcloth.solver.start import feasible_start

try:
    import casadi as ca
except ImportError:
    raise ImportError("this demo needs casadi: pip install '.[bench]'") from None

# Of the orderings of MUMPS, minimum degree (0) took the least time on these matrices.
IPOPT = {"tol": 1e-6, "mu_strategy": "adaptive", "linear_solver": "mumps", "mumps_pivot_order": 0}
UNSCALED, MONOTONE = {"nlp_scaling_method": "none"}, {"mu_strategy": "monotone"}
VARIANTS = {"IPOPT": {}, "IPOPT, unscaled": UNSCALED, "IPOPT, monotone barrier": MONOTONE}
CASES = [(ngcloth.scenes.hemisphere(ks), 0.15) for ks in (1, 10, 100)]
CASES += [(ngcloth.scenes.hemisphere(1), 0.1), (ngcloth.scenes.hemicatenoid(1), 0.2)]
CASES += [(ngcloth.scenes.sphere(0.85, shear_limit=np.cos(np.pi / 6)), 0.15)]


@dataclass(frozen=True)
class Outcome:
    """The patch IPOPT found; `history` has seconds, E/(2π kc) and violation of each iterate."""

    result: Result
    setup: float
    status: str
    history: np.ndarray

    @property
    def arrival(self):
        """Seconds after which all iterates are within 1e-4 of the last energy, and feasible."""
        seconds, energy, violation = self.history.T
        away = (np.abs(energy / energy[-1] - 1) > 1e-4) | (violation > 1e-4)
        return seconds[min(np.flatnonzero(np.r_[True, away])[-1], len(away) - 1)]


def solve_with_ipopt(
    scene, maxh, order=2, multiplier_order=None, quadrature=None, added=None, **ipopt
):
    """Solve a constrained scene by IPOPT, `ipopt` being options beyond or instead of `IPOPT`.

    `added` is the `limit_points` of a `Result` on the same mesh, to ask limits there as well. Other
    arguments are those of `ngcloth.solve`. The fabric must be written in plain arithmetic,
    as `ngcloth.Net` is. Returns an `Outcome`; the seconds and steps of its result are IPOPT's.
    """
    if not scene.constraints:
        raise InputError("scene", scene.name, "a scene with constraints")
    begin = time.perf_counter()
    settings = {"maxh": maxh, "order": order, "multiplier_order": multiplier_order or order}
    settings["quadrature"] = quadrature or 2 * order + 2
    problem = discretise(scene, **settings)
    if added is not None:
        problem.add_limit_points(added)
    program = Program(problem, settings["quadrature"])
    watch = Watch(program)
    options = {"ipopt": {"print_level": 0, "sb": "yes", **IPOPT, **ipopt}}
    options |= {"print_time": False, "show_eval_warnings": False, "no_nlp_grad": True}
    options |= {"iteration_callback": watch, **program.derivatives}
    solver = ca.nlpsol("peer", "ipopt", program.nlp, options)

    setup, watch.begin = time.perf_counter() - begin, time.process_time()
    answer = solver(x0=program.start, lbg=0, ubg=program.upper)
    seconds, stats = time.process_time() - watch.begin, solver.stats()
    problem.unknowns[program.unknowns] = np.array(answer["x"]).ravel()
    reason = Reason.CONVERGED if stats["success"] else Reason.BLOCKED
    energy, steps = float(answer["f"]), stats["iter_count"]
    result = Result(
        scene, problem.state, reason, energy, steps, seconds, [], settings, problem.sheet
    )
    history = np.array(watch.rows) * (1.0, scene.copies / (2 * np.pi), 1.0)
    return Outcome(result, setup, stats["return_status"], history)


def discretise(scene, maxh, order, multiplier_order, quadrature):
    """ngcloth's problem on ngcloth's mesh, at the scene's start, made feasible."""
    space = order, quadrature, "umfpack", multiplier_order
    *_, sheet = make_sheets(scene, maxh, order)
    problem = ClosedFormLagrangian(scene, sheet, *space)
    feasible_start(problem)
    return problem


class Watch(ca.Callback):
    """Called by IPOPT after each iteration: notes time, energy and violation."""

    def __init__(self, program):
        super().__init__()
        self.sizes = {"x": program.start.size, "g": program.upper.size, "f": 1}
        self.upper, self.rows, self.begin = program.upper, [], 0.0
        self.construct("watch")

    def get_n_in(self):  # noqa: D102
        return ca.nlpsol_n_out()

    def get_sparsity_in(self, i):  # noqa: D102
        return ca.Sparsity.dense(self.sizes.get(ca.nlpsol_out(i).removeprefix("lam_"), 0), 1)

    def eval(self, values):  # noqa: D102
        energy, g = (np.array(values[ca.nlpsol_out().index(name)]).ravel() for name in "fg")
        row = time.process_time() - self.begin, energy[0], np.maximum(-g, g - self.upper).max()
        self.rows.append(row)
        return [0]


class Cloth:
    """`ngcloth.kinematics.Kinematics` at a point, in casadi; NaN where J ≤ 0, to keep IPOPT out."""

    def __init__(self, gradient, metric, curvature, fabric):
        determinant = ca.det(gradient)
        self.fabric, self.jacobian = fabric, ca.if_else(determinant > 0, determinant, np.nan)
        inverse = ca.adj(gradient) / self.jacobian
        green, bent = (inverse.T @ tensor @ inverse for tensor in (metric, curvature))
        self.I4, self.I6, self.I8 = green[0, 0], green[1, 1], green[0, 1]
        self.stretches = ca.sqrt(self.I4), ca.sqrt(self.I6)
        self.shears = (self.I8 / ca.sqrt(self.I4 * self.I6),)
        invariants = ca.SX.sym("invariants", 3)
        energy = fabric.energy(*ca.vertsplit(invariants))
        law = ca.Function("law", [invariants], [energy, ca.gradient(energy, invariants)])
        self.energy, w = law(ca.vertcat(self.I4, self.I6, self.I8))
        self.reaction = -2 * ca.dot(symmetric(w[0], w[2] / 2, w[1]), bent)


def symmetric(t11, t12, t22):
    """The 2×2 tensor."""
    return ca.blockcat([[t11, t12], [t12, t22]])


@functools.cache
def point_kernels(fabric, constraints):
    """Energy, force and slacks at an integration point, and their derivatives by ∇ψ.

    The force multiplies ∇v in dE(ψ)[v]. Geometry is a column of the weight and of a and b, each as
    its entries 11, 12, 22.
    """
    gradient, sliding = ca.SX.sym("gradient", 4), ca.SX.sym("sliding", 4)
    geometry, sigma = ca.SX.sym("geometry", 7), ca.SX.sym("sigma")
    weight, *tensors = ca.vertsplit(geometry, [0, 1, 4, 7])
    metric, curvature = (symmetric(*ca.vertsplit(tensor)) for tensor in tensors)
    cloth = Cloth(ca.reshape(gradient, 2, 2).T, metric, curvature, fabric)
    energy = weight * cloth.jacobian / fabric.stiffness * cloth.energy
    force = ca.gradient(energy, gradient)
    slacks = ca.vertcat(*[c for limit in constraints for c in limit.slacks(cloth)])
    z = ca.SX.sym("z", slacks.numel())
    lagrangian = sigma * energy + ca.dot(sliding, force) + ca.dot(z, slacks)
    values = [energy, force, slacks]
    firsts = [ca.densify(ca.jacobian(value, gradient)) for value in values]
    seconds = [ca.densify(ca.hessian(lagrangian, gradient)[0])]
    return compiled(
        ca.Function("values", [gradient, geometry], values),
        ca.Function("firsts", [gradient, geometry], firsts),
        ca.Function("seconds", [gradient, geometry, sigma, sliding, z], seconds),
    )


def compiled(*kernels):
    """The kernels as functions of a C library, or as they are where there is no compiler."""
    compiler, source = shutil.which("cc"), ca.CodeGenerator("kernels.c")
    if compiler is None:
        return kernels
    for kernel in kernels:
        source.add(kernel)
    with tempfile.TemporaryDirectory() as folder:
        library = f"{folder}/kernels.so"
        flags = ["-O3", "-march=native", "-shared", "-fPIC", "-lm", "-o", library]
        subprocess.run([compiler, source.generate(f"{folder}/"), *flags], check=True)
        return [ca.external(kernel.name(), library) for kernel in kernels]


class Program:
    """The nonlinear program: point kernels between constant sparse matrices."""

    def __init__(self, problem, quadrature):
        free, last = np.flatnonzero(list(problem.free)), problem.psi_dofs.stop
        self.unknowns, multipliers = free[free < last], free[free >= last]
        state = problem.unknowns.copy()
        self.start, state[self.unknowns] = state[self.unknowns], 0.0
        # Other points than those inside weigh nothing: limits are all they have.
        inside, mesh = problem.points, problem.state.space.mesh
        others = [RimPoints(mesh, quadrature)]
        if len(problem.limit_points.triangles):
            others.append(AddedPoints(mesh, problem.limit_points))
        psi = at_points(problem.fes, (inside, *others), (0, 1))
        v = at_points(problem.fes, (inside, *others), (2, 3))
        held, psi, v = psi @ state, psi[:, self.unknowns.tolist()], v[:, multipliers.tolist()]
        families = [(inside, inside.weights), *((p, np.zeros(len(p))) for p in others)]
        n = sum(len(points) for points, _ in families)
        geometry = np.hstack([geometry_at_points(problem.sheet, *family) for family in families])
        kernels = point_kernels(problem.scene.fabric, problem.scene.constraints)
        values, firsts, seconds = (kernel.map(n) for kernel in kernels)
        n_v, n_slacks = v.size2(), values.numel_out(2)
        self.upper = np.r_[np.zeros(n_v), np.full(n_slacks, np.inf)]

        x, p, sigma = ca.MX.sym("x", psi.size2()), ca.MX.sym("p", 0, 1), ca.MX.sym("sigma")
        multiplier = ca.MX.sym("multiplier", self.upper.size)
        gradient = ca.reshape(psi @ x + held, 4, n)
        sliding = ca.reshape(v @ multiplier[:n_v], 4, n)
        z = ca.reshape(multiplier[n_v:], -1, n)
        energy, force, slacks = values(gradient, geometry)
        f, g = ca.sum2(energy), ca.vertcat(v.T @ ca.vec(force), ca.vec(slacks))
        energy, force, slacks = firsts(gradient, geometry)
        rows = ca.vertcat((v.T @ diagonal(force, n)) @ psi, diagonal(slacks, n) @ psi)
        second = diagonal(seconds(gradient, geometry, ca.repmat(sigma, 1, n), sliding, z), n)
        hessian = ca.triu((psi.T @ second) @ psi)
        self.nlp = {"x": x, "f": f, "g": g}
        self.derivatives = {
            "grad_f": ca.Function("nlp_grad_f", [x, p], [f, psi.T @ ca.vec(energy)]),
            "jac_g": ca.Function("nlp_jac_g", [x, p], [g, rows]),
            "hess_lag": ca.Function("nlp_hess_l", [x, p, sigma, multiplier], [hessian]),
        }


def at_points(fes, families, components):
    """The matrix from degrees of freedom to gradients of components, point by point."""
    n_fields, first, triplets = 2 * len(components), 0, []
    for points in families:
        for c, i in enumerate(components):
            sampling = Sampling(fes.components[i], points)
            triangles, _, at_one, _ = sampling.shapes.shape
            point = first + np.arange(triangles * at_one).reshape(triangles, 1, at_one, 1)
            field = 2 * c + np.arange(2).reshape(-1, 1, 1)
            columns = fes.Range(i).start + sampling.dofs[:, None, None]
            entries = np.broadcast_arrays(n_fields * point + field, columns, sampling.shapes)
            triplets.append([entry.ravel() for entry in entries])
        first += len(points)
    rows, columns, values = map(np.concatenate, zip(*triplets, strict=True))
    shape = n_fields * first, fes.ndof
    return ca.DM.triplet(rows.tolist(), columns.tolist(), values.tolist(), *shape)


def geometry_at_points(sheet, points, weights):
    """Weight, a and b at the points, (7, points)."""
    tensors = sheet.metric, sheet.curvature
    entries = [tensor[i] for tensor in tensors for i in ((0, 0), (0, 1), (1, 1))]
    return np.vstack([weights, points.sample_surface(ngs.CF(tuple(entries)))])


def diagonal(blocks, n):
    """The sparse matrix with these `n` blocks, side by side as they are, down its diagonal."""
    shape = blocks.size1(), blocks.size2() // n
    pattern = ca.kron(ca.DM.eye(n), ca.DM.ones(*shape)).sparsity()
    return ca.MX(pattern, ca.vec(blocks))


def main():
    """Print the table."""
    ngs.SetNumThreads(1)
    print(f"ngcloth {ngcloth.__version__}, ngsolve {ngs.__version__}, casadi {ca.__version__}")
    for scene, maxh in CASES:
        print(f"\n{scene.name}, maxh {maxh}")
        print(" " * 25, "E/(2π kc)  steps    λmax     area  seconds  status, setup, arrival")
        for end in (1e-4, 1e-6):
            begin = time.process_time()
            result = ngcloth.solve(scene, maxh=maxh, order=2, barrier_end=end)
            seconds = time.process_time() - begin
            report(f"ngcloth, barrier_end {end:g}", result, seconds, result.reason.name)
        for name, options in VARIANTS.items():
            peer = solve_with_ipopt(scene, maxh, added=result.limit_points, **options)
            status = f"{peer.status}, {peer.setup:.2f}, {peer.arrival:.2f}"
            report(name, peer.result, peer.result.seconds, status)


def report(name, result, seconds, status):
    """Print a row of the table."""
    stretch = max(result.extrema[key][1] for key in ("stretch1", "stretch2"))
    row = f"{name:25s} {result.normalized_energy:9.6f} {result.newton_iterations:6d} {stretch:7.4f}"
    print(f"{row} {result.area:8.5f} {seconds:8.2f}  {status}", flush=True)


if __name__ == "__main__":
    main()
