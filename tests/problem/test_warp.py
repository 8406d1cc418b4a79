"""The direction of the warp as an input: held at a point, kept in files, refused if it is none."""

import re
from dataclasses import replace

import numpy as np
import pytest
from geometry import shapes

import ngcloth
from ngcloth import Disk, Elongation, InputError, Net, Scene, Surface, scenes, solve
from ngcloth import __main__ as cli

DOME = Surface(lambda x, y: (x, y, -0.25 * x**2 - 0.6 * y**2), Disk(1.0))
AT = (0.3, 0.2, -0.25 * 0.09 - 0.6 * 0.04)
OBLIQUE = (0.5, 0.8, 0.4)


def angle_to(direction, tangents, slope):
    """Between the warp and a direction's projection on the surface, in degrees."""
    tangents = np.asarray(tangents, dtype=float)
    projected = tangents @ np.linalg.lstsq(tangents, direction, rcond=None)[0]
    warp = tangents @ np.linalg.solve(slope, [1.0, 0.0])
    cosine = warp @ projected / np.linalg.norm(warp) / np.linalg.norm(projected)
    sine = np.linalg.norm(np.cross(warp, projected)) / np.linalg.norm(warp)
    return np.degrees(np.arctan2(sine / np.linalg.norm(projected), cosine))


@pytest.mark.parametrize(
    ("ks", "limits"), [(1.0, [Elongation()]), (1.0, []), (0.0, [])], ids=["taut", "slack", "net"]
)
def test_the_warp_runs_as_given(ks, limits):
    """Exactly at the point, nearly beside it, for all kinds of scenes; and in few steps.

    Taut cloth is solved on two meshes.
    """
    result = solve(Scene(DOME, Net(ks=ks), limits, warp=OBLIQUE, at=AT), maxh=0.15)
    assert result.converged and result.newton_iterations <= 40
    theta = np.array(AT[:2])
    for off, most in ((0.0, 1e-10), (0.1, 3.0)):
        x, y = theta + off
        tangents = [[1, 0], [0, 1], [-0.5 * x, -1.2 * y]]
        slope = result.slopes(theta + off)
        assert angle_to(OBLIQUE, tangents, slope) < most
    assert angle_to(OBLIQUE, [[1, 0], [0, 1], [-0.15, -0.24]], result.slopes(theta)) < 1e-10
    assert result.warp @ OBLIQUE > 0 and "as given" in str(result)


def test_both_linearisations_hold_it():
    scene = Scene(DOME, Net(ks=1.0), [Elongation()], warp=(-1, 1, 0))
    one, other = (
        solve(scene, maxh=0.5, linearisation=kind) for kind in ("closed form", "automatic")
    )
    assert one.newton_iterations == other.newton_iterations
    assert one.energy == pytest.approx(other.energy, rel=1e-8)
    assert one.warp == pytest.approx([-(0.5**0.5), 0.5**0.5, 0], abs=1e-12)


def test_the_optimum_among_patches_so_turned():
    """The energy depends on the direction smoothly, and least where the optimum's own is given."""
    free = solve(Scene(DOME, Net(ks=10.0)), maxh=0.3)
    turned = [np.array([np.cos(t), np.sin(t), 0]) for t in np.radians([-40, -20, 20, 40])]
    scene = Scene(DOME, Net(ks=10.0), warp=free.warp)
    same = solve(scene, maxh=0.3)
    assert same.energy == pytest.approx(free.energy, rel=1e-4)
    others = [solve(replace(scene, warp=each), maxh=0.3).energy for each in turned]
    assert min(others) > same.energy and others[0] > others[1] and others[3] > others[2]


def test_certificate_of_a_given_direction():
    """A minimum among patches with this direction is none among all, and the certificate knows."""
    scene = Scene(DOME, Net(ks=10.0), warp=(1, 0.5, 0))
    result = solve(scene, maxh=0.15)
    certificate = result.certificate()
    assert certificate.certified, str(certificate)
    free = replace(result, scene=replace(scene, warp=None, at=None)).certificate()
    assert free.stationarity > 1e2 * certificate.stationarity
    # Any turn costs now.
    own = solve(Scene(DOME, Net(ks=10.0)), maxh=0.3).certificate()
    assert certificate.curvature > 3 * own.curvature


@pytest.fixture(scope="module")
def scan():
    return Surface.from_mesh(shapes.facets(9))


def test_a_surface_from_a_file(tmp_path, scan):
    at = np.array([0.2, -0.4, 0.9]) / np.linalg.norm([0.2, -0.4, 0.9])
    scene = scenes.part(scan, ks=1.0, warp=(0.3, 1.0, 0.2), at=at)
    result = solve(scene, maxh=0.4)
    projected = scene.warp - (at @ scene.warp) * at
    assert result.converged
    assert result.warp == pytest.approx(projected / np.linalg.norm(projected), abs=5e-3)
    result.save(tmp_path / "dome")
    again = ngcloth.load(tmp_path / "dome")
    assert again.scene.warp == scene.warp and again.warp == pytest.approx(result.warp, abs=1e-12)
    other = scenes.part(scan, ks=1.0, warp=(1.0, 0.0, 0.0), at=at)
    for wrong in (other, scenes.part(scan, ks=1.0)):
        with pytest.raises(InputError, match="warp differ"):
            ngcloth.load(tmp_path / "dome", wrong)


def test_a_checkpoint_knows_the_direction(tmp_path):
    scene = Scene(DOME, Net(ks=1.0), [Elongation()], warp=(1, 1, 0))
    settings = {"maxh": 0.5, "checkpoint": tmp_path / "half"}
    assert not solve(scene, max_steps=3, **settings).converged
    with pytest.raises(InputError, match="checkpoint"):
        solve(replace(scene, warp=(1, 0, 0)), **settings)
    resumed, whole = solve(scene, **settings), solve(scene, maxh=0.5)
    assert resumed.converged and resumed.energy == pytest.approx(whole.energy, rel=1e-9)


@pytest.mark.parametrize(
    ("warp", "at", "said"),
    [
        ((0, 0, 1), None, "warp = .* normal to it"),
        ((0, 0, 0), None, "warp = .* not zero"),
        ((1, np.nan, 0), None, "warp = .* three finite numbers"),
        ((1, 0), None, "warp = .* three finite numbers"),
        ("x", None, "warp = .* three finite numbers"),
        ((1, 0, 0), (0, 0, 0.3), "at = .* a point of the surface; the nearest"),
        ((1, 0, 0), (2, 0, -1), "at = .* a point of the surface; the nearest"),
        ((1, 0, 0), (np.inf, 0, 0), "at = .* three finite numbers"),
        (None, (0, 0, 0), "at = .* None without"),
    ],
)
def test_refused_directions(warp, at, said):
    with pytest.raises(InputError, match=said):
        Scene(DOME, Net(), warp=warp, at=at)


def test_a_direction_that_fits_the_mirrors():
    """ψ2 = 0 holds it on one mirror line exactly; across the other the solution is even."""
    for at, error in (((0.5, 0, -0.0625), 1e-12), ((0, 0.5, -0.15), 2e-3)):
        scene = Scene(DOME, Net(ks=1.0), symmetric=True, warp=(1, 0, -0.5 * at[0]), at=at)
        assert not scene.in_equilibrium
        result = solve(scene, maxh=0.3)
        assert np.cross(result.warp, scene.warp) == pytest.approx(0, abs=error)
    for warp, at in (((0, 1, 0), None), ((-1, 0, 0), None), ((1, 0, 0), AT)):
        with pytest.raises(InputError, match="mirror"):
            Scene(DOME, Net(ks=1.0), symmetric=True, warp=warp, at=at)


def test_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cli, "FILES", {"result": cli.FILES["result"]})
    shapes.hemisphere().WriteStep(str(tmp_path / "dome.step"))
    options = ["--faces", "dome", "--ks", "1", "--maxh", "0.6", "--quiet", "--out", str(tmp_path)]
    told = ["--warp", "-1,0,0", "--at", "0,0,1"]
    assert cli.main([str(tmp_path / "dome.step"), *options, *told]) == 0
    said = capsys.readouterr().out
    assert re.search(r"warp along \((-1|-0\.999\d), .* at \(0, 0, 1\), as given", said)
    with pytest.raises(SystemExit) as ended:
        cli.main([str(tmp_path / "dome.step"), "--warp", "1,0"])
    assert ended.value.code == cli.BAD_INPUT
