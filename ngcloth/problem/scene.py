"""What the user says: surface, fabric, limits, symmetry and start. Validates, computes nothing."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import ngsolve as ngs
import numpy as np
from netgen.meshing import NgException

from ..errors import InputError, check_number
from ..geometry.file_surface import FileSurface
from . import returned
from .constraints import Elongation, Obstacle, ShearLimit
from .domain import Disk
from .fabric import STIFFNESSES, Net, directions, of_curvature, of_place
from .kinematics import Kinematics
from .states import MIRRORS, SAME, States
from .surface import Surface
from .warp import checked_warp, in_words

OFF = 1e6  # energies over stiffness are within
UNDEFORMED, STRETCHED = (1.0, 1.0, 0.0), ((1.21, 1.0, 0.0), (1.0, 1.21, 0.0), (1.0, 1.0, 0.3))
EVENNESS = 1e-3  # last weight of the tie-break where the net is not unique
PLACES = 4000  # at which a metric is compared with its mirror image


@dataclass(frozen=True)
class Scene:
    """One clothing problem: which flat patch best covers the surface?

    Parameters
    ----------
    surface : Surface
        The target surface N = φ(U), by a chart or from a file.
    fabric : Net
        The strain energy W(I4, I6, I8) of the cloth.
    constraints : sequence, optional
        Limits to respect, such as `Elongation`, `ShearLimit` or `Obstacle`; or any object with a
        `name` and a method ``slacks(cloth)`` that returns expressions of a `Kinematics`, positive
        where the limit holds. With any of them the patch is also held to in-plane equilibrium.
    start : (float, float) or callable, optional
        First guess of ψ: a pair (s1, s2) means ψ = (s1 θ1, s2 θ2); a callable of (θ1, θ2) returns
        the two components as NGSolve expressions. Only its gradient matters, ψ being free up to a
        translation. By default the pair that makes both stretches 1 in the mean; for surfaces from
        files θ is a flattening as rigid as possible, and the pair is (1, 1). With limits, which it
        need not respect, a guess far from isometric is flattened first, and one outside them
        scaled.
    cost : callable, optional
        A cost density χ per flat area to minimise in place of the strain energy: a function of a
        `Kinematics` that returns an expression, in the unit of a stiffness. With it the patch is
        held to in-plane equilibrium even without constraints.
    symmetric : bool, optional
        Solve on a quarter of the domain, with mirror lines through its centre: ψ1 odd and ψ2 even
        across θ1 = centre, ψ2 odd and ψ1 even across θ2 = centre. A file has to hold the quarter
        alone, from CAD, its edges in the mirror planes θ1 = 0 and θ2 = 0 named "mirror1" and
        "mirror2"; the result is the whole patch. Default False.
    tie_break : float, optional
        For surfaces whose Chebyshev net is not unique: choose one by adding ε/2 times ∫ |∇∇∇ψ|²
        (as the variation of ∇∇ψ in each element, and with a little of ∫ |∇∇ψ|²) to E/kc, and so
        prefer nets that bend evenly. The value is the last ε, from which the solve ends with some
        steps on E alone; 0, the default, leaves all this out in scenes with symmetry, limits or
        shear stiffness. Without these any two curves may be threads, and 0 means 1e-3. Where the
        net is not unique the patch still moves with ε and the mesh; where it is unique it does not.
    name : str, optional
        How the scene is called in printed lines and figures.
    warp : (float, float, float), optional
        A direction in space. The warp runs along its projection on the surface, at `at`, and the
        start is turned that way; the patch is held to in-plane equilibrium even without
        constraints, unless it is a Chebyshev net. By default the optimum chooses its direction.
    at : (float, float, float), optional
        The point of the surface, in space, of `warp`. By default the centre of a chart's domain,
        and one near the middle of a surface from a file, which the result tells.

    Attributes
    ----------
    recipe : dict or None
        Which function of `ngcloth.scenes` made the scene, with which arguments; None for any
        other scene.

    Raises
    ------
    InputError
        If an argument is of the wrong kind, or a function of it returns what is; if `at` is off the
        surface, or `warp` normal to it there, or, with mirrors, not along θ1; if the fabric's
        energy or stress is not finite in the undeformed cloth, or is out of proportion to its
        stiffness; if the start folds the cloth (J ≤ 0) or has no finite energy somewhere; if
        NGSolve does not find the derivatives of energy, slacks or cost; or if surface, fabric,
        limits, cost or start do not have the symmetry asked for.
    Exception
        What a function of the user's own raises, with a note of where it was called.
    """

    surface: Surface
    fabric: Net
    constraints: tuple = ()
    start: tuple | Callable | None = None
    cost: Callable | None = None
    symmetric: bool = False
    tie_break: float = 0.0
    name: str = "scene"
    warp: tuple | None = None
    at: tuple | None = None
    recipe = None

    def __post_init__(self):
        if not isinstance(self.surface, Surface | FileSurface):
            raise InputError("surface", self.surface, "an ngcloth.Surface")
        if isinstance(self.fabric, type) or not callable(getattr(self.fabric, "energy", None)):
            raise InputError(
                "fabric", self.fabric, "an ngcloth.Net, or an object with its `energy`"
            )
        check_number("fabric.stiffness", returned.stiffness(self.fabric), *STIFFNESSES)
        directions(self.fabric)  # are checked there
        try:
            object.__setattr__(self, "constraints", tuple(self.constraints))
        except TypeError:
            raise InputError("constraints", self.constraints, "a sequence of constraints") from None
        for each in self.constraints:
            known = isinstance(getattr(each, "name", None), str)
            if isinstance(each, type) or not (known and callable(getattr(each, "slacks", None))):
                raise InputError("constraints", each, "objects with `name` and `slacks(cloth)`")
        if not (self.cost is None or callable(self.cost)):
            raise InputError("cost", self.cost, "a callable of a Kinematics, or None")
        if not isinstance(self.symmetric, bool):
            raise InputError("symmetric", self.symmetric, "True or False")
        if isinstance(self.surface, FileSurface):
            self._check_file()
        if not (isinstance(self.name, str) and self.name.isprintable()):
            raise InputError("name", self.name, "a text of one line, without control characters")
        if of_curvature(self.fabric) and any(isinstance(c, Obstacle) for c in self.constraints):
            allowed = "no Obstacle with threads that resist bending: Laplace's law is not all of it"
            raise InputError("constraints", self.constraints, allowed)
        for argument, value in zip(("warp", "at"), checked_warp(self), strict=True):
            object.__setattr__(self, argument, value)
        self._check_energy()
        object.__setattr__(self, "tie_break", check_number("tie_break", self.tie_break, 0, 1))
        if self.tie_break and self.in_equilibrium:
            allowed = "0 with constraints, a cost, or a direction of the warp"
            raise InputError("tie_break", self.tie_break, allowed)
        slopes = self._check_start()
        if self.symmetric and isinstance(self.surface, Surface):
            self._check_mirrors()
        laws = {type(each) for each in (self.fabric, *self.constraints)}
        # The derivatives and the symmetry of these are known; an obstacle feels the curvature, too.
        foreign = self.cost is not None or not laws <= {Net, Elongation, ShearLimit, Obstacle}
        mirrored = self.symmetric and (foreign or Obstacle in laws)
        if foreign or mirrored:
            states = States(self, slopes)
            states.check_derivatives()
            if mirrored:
                states.check_mirrors()

    @property
    def in_equilibrium(self):
        """Whether equilibrium has to be imposed; minima of E alone have it by themselves."""
        held = self.warp is not None and not self.symmetric and not self._of_threads
        return bool(self.constraints) or self.cost is not None or held

    @property
    def _of_threads(self):
        return isinstance(self.fabric, Net) and self.fabric.ks == 0

    @property
    def inextensible(self):
        """Whether this is a Chebyshev scene: E is nothing but thread energy, and can vanish."""
        return self._of_threads and not self.in_equilibrium

    @property
    def net_choice(self):
        """The last ε of the tie-break; 0 where there is nothing to choose."""
        free = self.inextensible and not self.symmetric
        return self.tie_break or (EVENNESS if free else 0.0)

    @property
    def copies(self):
        """How many mirror images of the meshed domain make up the whole: 4 or 1."""
        return 4 if self.symmetric else 1

    @property
    def normalisation(self):
        """2π kc, the unit in which the paper gives energies."""
        return 2 * np.pi * self.fabric.stiffness

    @property
    def tried_on(self):
        """The surface on which functions of the user's own are tried: this one, if it has a chart.

        Otherwise it is a cap of the same size.
        """
        if isinstance(self.surface, Surface):
            return self.surface
        return _cap(self.surface.size)

    def start_expression(self):
        """The first guess, a pair of NGSolve expressions of x = θ1, y = θ2, zero at the centre."""
        start, chart = self.start, self.tried_on
        if callable(start):
            told = "start", start, "start(θ1, θ2)", "two components of ψ"
            psi = returned.vector(*told, 2, start)
        else:
            if start is None and chart is not self.surface:
                start = 1.0, 1.0
            elif start is None:
                metric = chart.evaluate(chart.metric, chart.domain.sample())
                start = np.sqrt(np.diagonal(metric, axis1=1, axis2=2)).mean(axis=0)
            psi = ngs.CF((float(start[0]) * ngs.x, float(start[1]) * ngs.y))
        at_centre = chart.evaluate(psi, chart.domain.centre)
        return psi[0] - float(at_centre[0]), psi[1] - float(at_centre[1])

    def _check_energy(self):
        """The fabric's energy is finite near the undeformed cloth, and of the size it says."""
        fabric, stiffness = self.fabric, float(self.fabric.stiffness)
        invariants = [ngs.Parameter(value) for value in (1.0, 1.0, 0.0)]
        place = self.start_expression() if of_place(fabric) else ()
        flat = 3 * (ngs.CF(0.0),) if of_curvature(fabric) else ()
        energy = returned.energy(fabric, *invariants, *flat, *place)
        try:
            stress = ngs.CF((energy, *(energy.Diff(invariant) for invariant in invariants)))
        except NgException as error:
            text = " ".join(str(error).split())
            allowed = f"`energy(I4, I6, I8)` must have derivatives ({text})"
            raise InputError("fabric", fabric, allowed) from error
        points = self.tried_on.domain.sample(5)
        values = []
        for state in UNDEFORMED, *STRETCHED:
            for invariant, value in zip(invariants, state, strict=True):
                invariant.Set(value)
            values.append(self.tried_on.evaluate(stress, points))
        if not np.isfinite(values[0]).all():
            allowed = "energy and derivatives must be finite at I4 = I6 = 1, I8 = 0"
            raise InputError("fabric", fabric, allowed)
        gained = np.abs(np.array(values)[1:, :, 0] - values[0][:, 0]) / stiffness
        gained = np.nanmax(np.where(np.isfinite(gained), gained, np.nan), axis=1, initial=0.0)
        if not (gained.max() > 1 / OFF and gained[:2].max() < OFF):
            allowed = (
                f"about the stiffness of its threads: `{type(fabric).__name__}.energy` in threads "
                f"10 % longer is {gained[:2].max():.1e} of it, with shear {gained.max():.1e}"
            )
            raise InputError("fabric.stiffness", fabric.stiffness, allowed)

    def _check_mirrors(self):
        """The domain and the metric of the surface have the mirror symmetry of the scene."""
        surface, domain = self.surface, self.surface.domain
        points = np.random.default_rng(0).uniform(*np.transpose(domain.box), (PLACES, 2))
        points = points[domain.contains(points)]
        metric = surface.evaluate(surface.metric, points)
        size = np.trace(metric, axis1=1, axis2=2)[:, None, None]
        for axis, mirror in enumerate(MIRRORS):
            image = points.copy()
            image[:, axis] = 2 * domain.centre[axis] - image[:, axis]
            within = domain.contains(image)
            there = mirror @ surface.evaluate(surface.metric, image) @ mirror
            wrong = ~within | (np.abs(metric - there) > SAME * size).any(axis=(1, 2))
            if wrong.any():
                where = tuple(float(t) for t in points[np.argmax(wrong)])
                allowed = (
                    "with the mirror symmetry of the scene: its metric a at the mirror image "
                    f"across θ{axis + 1} = {domain.centre[axis]:.4g} must be the mirror image of "
                    f"a; not so at θ = {where}"
                )
                raise InputError("surface", surface, allowed)

    def _check_start(self):
        if self.start is not None and not callable(self.start):
            if not isinstance(self.start, tuple | list | np.ndarray) or len(self.start) != 2:
                raise InputError("start", self.start, "a pair (s1, s2) or a callable of (θ1, θ2)")
            for factor in self.start:
                check_number("start", factor)
        psi1, psi2 = self.start_expression()
        slopes = ngs.CF(
            tuple(psi.Diff(theta) for psi in (psi1, psi2) for theta in (ngs.x, ngs.y)), dims=(2, 2)
        )
        whole = isinstance(self.surface, Surface)
        sheet = self.surface
        if not whole:
            sheet = sheet.quarter[0] if self.symmetric else sheet.survey
        tensors = sheet.metric, self.fabric, lambda: sheet.curvature
        cloth = Kinematics(slopes, *tensors, (psi1, psi2))
        checked = ngs.CF((cloth.jacobian, cloth.energy))
        if whole:
            points = self.surface.domain.sample()
            values = self.surface.evaluate(checked, points)
        else:
            rule = ngs.IntegrationRule(ngs.TRIG, 2)
            points = sheet.mesh.MapToAllElements(rule, ngs.VOL)
            values = checked.Compile()(points)
            points = ngs.CF((ngs.x, ngs.y))(points)
        values = np.where(np.isfinite(values), values, np.nan)
        worst = int(np.argmin(values[:, 0]))  # a NaN, if there is one
        if not values[worst, 0] > 0:
            where = tuple(float(t) for t in points[worst])
            raise InputError(
                "start",
                self.start,
                f"J = det ∇ψ must be > 0, and is {values[worst, 0]:.3g} at θ = {where}",
            )
        worst = int(np.argmax(np.isnan(values[:, 1])))
        if np.isnan(values[worst, 1]):
            where = tuple(float(t) for t in points[worst])
            raise InputError(
                "start", self.start, f"the fabric has no finite energy there at θ = {where}"
            )
        if self.symmetric:
            psi, chart = ngs.CF((psi1, psi2)), self.tried_on
            domain = chart.domain
            points = domain.sample()
            here = chart.evaluate(psi, points)
            for axis, flip in enumerate([(-1, 1), (1, -1)]):
                image = points.copy()
                image[:, axis] = 2 * domain.centre[axis] - image[:, axis]
                there = chart.evaluate(psi, image) * flip
                if not np.allclose(here, there, atol=1e-9 * np.abs(here).max()):
                    raise InputError(
                        "start", self.start, "a map with the mirror symmetry of the scene"
                    )
        return slopes

    def _check_file(self):
        """What cannot be asked of a surface from a file."""
        if self.symmetric:
            _ = self.surface.quarter  # is checked there
        if not any(isinstance(limit, Obstacle) for limit in self.constraints):
            return
        sharp, noise = self.surface.sharp, self.surface.rough
        if sharp or noise:
            found = f"edges sharper than 5°, {sharp:.3g} {self.surface.unit} of them"
            found = "too much noise for its curvature" if noise else found
            allowed = f"no Obstacle on this surface, whose reaction is not known: it has {found}"
            raise InputError("constraints", self.constraints, allowed)

    def __str__(self):
        if isinstance(self.surface, FileSurface):
            domain = str(self.surface).partition("\n")[0]
        else:
            domain = f"{self.surface.domain}"
        domain += ", one quarter" if self.symmetric else ""
        terms = ["E(ψ), the strain energy" if self.cost is None else "∫ J χ, a cost of its own"]
        if self.net_choice:
            evenest = f"ε/2 ∫ |∇∇∇ψ|² down to ε = {self.net_choice:g}, to choose the evenest net"
            terms.append(evenest)
        unknowns = "ψ1, ψ2"
        if self.in_equilibrium:
            unknowns += ", v1, v2"
            terms.append("dE(ψ)[v], in-plane equilibrium")
            terms += [f"barrier of {limit}" for limit in self.constraints]
        if self.warp is not None:
            terms.append(f"warp along {in_words(self.warp)} at {in_words(self.at)}")
        return "\n".join(
            [
                f"{self.name}",
                f"  domain  {domain}",
                f"  fabric  {self.fabric}",
                f"  unknown {unknowns}",
                "  terms   " + "; ".join(terms),
            ]
        )


@cache
def _cap(size):
    return Surface(lambda x, y: (x, y, (x * x + y * y / 2) / size), Disk(size / 2))
