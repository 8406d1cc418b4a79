"""Surfaces from facets: exact and noisy hemispheres, every format, and bad files."""

import os

import ngsolve as ngs
import numpy as np
import pytest
import pyvista
import shapes

from ngcloth.errors import InputError
from ngcloth.geometry.facets import from_mesh


@pytest.fixture(scope="module")
def exact():
    return from_mesh(shapes.facets(20))


def integral(sheet, density, rule=ngs.dx):
    return ngs.Integrate(ngs.CF(density) * rule(bonus_intorder=10), sheet.mesh)


def rms(sheet, error):
    area = ngs.sqrt(ngs.Det(sheet.metric))
    return np.sqrt(integral(sheet, area * error**2) / integral(sheet, area))


def saved(path, points, triangles):
    faces = np.column_stack([np.full(len(triangles), 3), triangles])
    mesh = pyvista.PolyData(points, faces)
    (mesh.cast_to_unstructured_grid() if path.suffix == ".vtu" else mesh).save(path)


@pytest.mark.parametrize("size", [0.3, 0.15])
def test_the_mesh_does_not_depend_on_the_facets(exact, size):
    """2400 facets are in error by 1e-3; on meshes coarser than they, the sphere comes back."""
    coarse, sheet = exact.sheets(size, order=2, coarser=1)
    assert sheet.mesh.ne == 4 * coarse.mesh.ne
    scale = (size / 0.3) ** 3
    assert rms(sheet, ngs.Norm(sheet.position) - 1) < 3e-4 * scale
    assert rms(sheet, ngs.Norm(sheet.normal - sheet.position)) < 3e-3 * scale
    assert rms(sheet, sheet.mean_curvature + 1) < 2e-2 * scale**0.5
    area = integral(sheet, ngs.sqrt(ngs.Det(sheet.metric)))
    assert area == pytest.approx(2 * np.pi, rel=1e-3 * scale)
    on_rim = integral(sheet, sheet.position[2] ** 2, ngs.ds) ** 0.5
    assert on_rim < 1e-3 * scale
    assert exact.noise < 1e-6 and not exact.rough and "no" in str(exact)


def test_noise_is_estimated_and_smoothed():
    scan = from_mesh(shapes.facets(28, noise=1e-3))
    assert scan.noise == pytest.approx(1e-3, rel=0.1)
    assert not scan.rough and scan.curvature_error < 0.03
    (sheet,) = scan.sheets(0.15, order=2)
    assert rms(sheet, sheet.mean_curvature + 1) < 5e-2
    assert rms(sheet, ngs.Norm(sheet.position) - 1) < 3e-4
    raw = from_mesh(shapes.facets(28, noise=1e-3), smoothing=0)
    (sheet,) = raw.sheets(0.15, order=2)
    assert rms(sheet, sheet.mean_curvature + 1) > 0.1


def test_too_much_noise_for_curvature_is_told():
    with pytest.warns(UserWarning, match="too rough"):
        scan = from_mesh(shapes.facets(16, noise=1e-2))
    assert scan.rough and "too much for curvature" in str(scan)
    assert scan.noise == pytest.approx(1e-2, rel=0.15)


@pytest.mark.parametrize("ending", [".stl", ".obj", ".ply", ".vtp", ".vtu", ".STL"])
def test_every_format(tmp_path, ending):
    points, triangles = shapes.facets(9)
    saved(tmp_path / ("part" + ending.lower()), points, triangles)
    (tmp_path / ("part" + ending.lower())).rename(tmp_path / ("part" + ending))
    part = from_mesh(tmp_path / ("part" + ending), unit="cm")
    assert len(part.points) == len(points) and len(part.triangles) == len(triangles)
    assert part.area == pytest.approx(2 * np.pi, rel=1e-4)
    assert "cm" in str(part)


@pytest.mark.parametrize("ending", [".obj", ".ply"])
def test_a_tube_that_was_cut_open(tmp_path, ending):
    n, m = 24, 12
    points, triangles = shapes.tube(2.0, n=n, m=m)
    seam = np.arange(0, len(points), n)
    last = (triangles % n == n - 1).any(axis=1)[:, None] & (triangles % n == 0)
    triangles = np.where(last, len(points) + triangles // n, triangles)
    points = np.concatenate([points, points[seam]])  # both sides of the cut are in one place
    path = tmp_path / f"cut{ending}"
    if ending == ".ply":
        saved(path, points, triangles)
    else:  # with textures, by which VTK would take all triangles apart
        lines = ["v {} {} {}".format(*point) for point in points] + ["vt 0 0", "vt 1 0", "vt 0 1"]
        lines += ["f {}/1 {}/2 {}/3".format(*corners) for corners in triangles + 1]
        path.write_text("\n".join(lines))
    tube = from_mesh(path)
    assert len(tube.topology.rims) == 1 and tube.area == pytest.approx(4 * np.pi, rel=1e-3)
    (sheet,) = type(tube).of_arrays(tube.arrays()).sheets(0.4, order=2)
    assert integral(sheet, 1) == pytest.approx(4 * np.pi, rel=2e-2)  # it unrolls


def test_sharp_edges_are_told():
    points, triangles = strip(2.0, 1.0, 48)
    points[:, 2] = np.abs(points[:, 0] - 1)
    with pytest.warns(UserWarning, match="sharper than 5°"):
        assert from_mesh((points, triangles)).sharp > 0.3


def twisted(n):
    """A strip with vertices but on its rims and its middle, and far denser along than across."""
    x, y = np.meshgrid(np.linspace(0, 2, n), [-1.0, 0, 1], indexing="ij")
    points = np.stack([x, y * np.cos(2 * x), y * np.sin(2 * x)], axis=-1).reshape(-1, 3)
    a = np.add.outer(3 * np.arange(n - 1), [0, 1]).ravel()
    return points, np.concatenate([np.stack(t, 1) for t in ((a, a + 3, a + 4), (a, a + 4, a + 1))])


def test_side_and_mixed_orientation():
    points, triangles = shapes.facets(9)
    triangles[::3] = triangles[::3][:, [1, 0, 2]]
    for side in (1, -1):
        (sheet,) = from_mesh((points, triangles), side=side).sheets(0.3, order=2)
        assert rms(sheet, ngs.Norm(sheet.normal - side * sheet.position)) < 1e-2


def test_a_hole_and_corners_of_the_rim():
    part = from_mesh(shapes.facets(16, hole=4))
    polar = np.pi / 8
    (sheet,) = part.sheets(0.2, order=3)
    along = ngs.specialcf.tangential(2)
    length = ngs.sqrt(ngs.InnerProduct(sheet.metric * along, along))
    low = integral(sheet, length * ngs.IfPos(sheet.position[2] - 0.4, 0, 1), ngs.ds)
    assert low == pytest.approx(2 * np.pi, rel=1e-3)
    assert len(part.topology.rims) == 2 and part.area == pytest.approx(
        2 * np.pi * np.cos(polar), rel=1e-2
    )
    # A quarter of a cylinder: its rim has four corners, and they stay.
    angle, z = np.meshgrid(np.linspace(0, np.pi / 2, 21), np.linspace(0, 2, 21), indexing="ij")
    grid = pyvista.StructuredGrid(np.cos(angle), np.sin(angle), z)
    sheet = grid.extract_surface(algorithm=None).triangulate()
    part = from_mesh((np.array(sheet.points, dtype=float), sheet.regular_faces))
    (chart,) = part.sheets(0.3, order=3)
    vertices = np.array([chart.position(chart.mesh(*v.point)) for v in chart.mesh.vertices])
    for corner in ((1, 0, 0), (0, 1, 0), (1, 0, 2), (0, 1, 2)):
        assert np.linalg.norm(vertices - corner, axis=1).min() < 1e-5
    assert part.area == pytest.approx(np.pi, rel=1e-4)


def strip(length, width, n=12):
    x, y = np.meshgrid(length * np.linspace(0, 1, n), width * np.linspace(0, 1, n), indexing="ij")
    a, b, c, d = (
        np.arange(n * n).reshape(n, n)[i : n - 1 + i, j : n - 1 + j].ravel()
        for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))
    )
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]), triangles


def scattered(shape):
    return np.random.default_rng(0).normal(size=shape)


def broken(change):
    points, triangles = shapes.facets(9)
    return change(points, triangles)


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (broken(lambda p, t: (np.where(p > 0.999, np.nan, p), t)), "finite points"),
        (broken(lambda p, t: (p, t + 1)), "numbers from 0 to"),
        (broken(lambda p, t: (p, t[:4])), "at least 36 vertices"),
        (broken(lambda p, t: (p[:, :2], t)), "points of shape"),
        (broken(lambda p, t: (p, t[:0])), "none in it"),
        (broken(lambda p, t: (p, 1.0 * t)), "whole numbers"),
        (broken(lambda p, t: (0 * p, t)), "all points are one"),
        (broken(lambda p, t: (1e-6 * p, t)), "is that its unit"),
        (
            broken(lambda p, t: (np.vstack([p, p + 5]), np.vstack([t, t + len(p)]))),
            "2 loose parts.*cut the part",
        ),
        (broken(lambda p, t: (np.vstack([p, -p]), np.vstack([t, t + len(p)]))), "closed|loose"),
        (strip(2000.0, 0.2), "can be meshed"),
        (twisted(41), "facets near a smooth surface"),
        (broken(lambda p, t: (p + scattered(p.shape), t)), "a smooth surface|laid flat"),
        (shapes.tube(0.2), "a tube; cut it open"),
        (shapes.tube(3.0), "a tube; cut it open"),
        ((1, 2, 3), "a pair of points and triangles"),
    ],
)
def test_refused_facets(source, said):
    with pytest.raises(InputError, match=said):
        from_mesh(source)


@pytest.mark.parametrize("ending", [".stl", ".obj", ".ply", ".vtp", ".vtu"])
def test_refused_files(tmp_path, ending):
    path = tmp_path / f"part{ending}"
    with pytest.raises(InputError, match="No such file"):
        from_mesh(path)
    os.mkfifo(tmp_path / f"pipe{ending}")
    with pytest.raises(InputError, match="a plain file"):
        from_mesh(tmp_path / f"pipe{ending}")
    saved(path, *shapes.facets(9))
    data = path.read_bytes()
    for content in (b"", data[: len(data) // 3], bytes(range(256)) * 8):
        path.write_bytes(content)
        with pytest.raises(InputError, match="path"):  # some bring down the reader
            from_mesh(path)
