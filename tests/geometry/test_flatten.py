"""Triangles laid in the plane without flips; what hangs together, and what is no disk."""

import numpy as np
import pytest
import shapes

from ngcloth.geometry.flatten import FlatteningError, flatten, gradients, is_embedding
from ngcloth.geometry.topology import clean, topology


def grid(n, m):
    """Points of the unit square and its triangles."""
    u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij")
    i, j = np.meshgrid(range(n), range(m), indexing="ij")
    a = (i * (m + 1) + j).ravel()
    b, c, d = a + m + 1, a + m + 2, a + 1
    triangles = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    return np.stack([u.ravel(), v.ravel()], axis=-1), triangles


def stretches(points, triangles, flat):
    return np.linalg.svd(gradients(points, triangles, flat), compute_uv=False)


def test_a_developable_surface_is_unrolled_isometrically():
    square, triangles = grid(20, 9)
    angle = 2 * square[:, 0]
    points = np.stack([np.sin(angle), square[:, 1], -np.cos(angle)], axis=-1)
    found, _ = topology(triangles)
    flat = flatten(points, triangles, found.rims)
    assert is_embedding(flat, triangles, found.rims)
    strains = stretches(points, triangles, flat) - 1
    assert np.sqrt(np.mean(strains**2)) < 5e-3 and np.abs(strains).max() < 0.03
    # Centred, the first axis along x: half of the arc of chords, and half of the height.
    assert flat.max(axis=0) == pytest.approx([20 * np.sin(0.05), 0.5], abs=0.01)


def test_a_hemisphere_is_laid_without_flips():
    points, triangles = shapes.facets(12)
    found, turned = topology(triangles)
    assert not turned.any() and (found.euler, len(found.rims), found.parts) == (1, 1, 1)
    flat = flatten(points, triangles, found.rims)
    assert is_embedding(flat, triangles, found.rims)
    singular = stretches(points, triangles, flat)
    assert 0.7 < singular.min() and singular.max() < 1.5


def test_holes_stay_open():
    points, triangles = shapes.facets(12, hole=4)
    points, triangles = clean(points, triangles)
    found, _ = topology(triangles)
    assert found.fault is None and (found.euler, len(found.rims)) == (0, 2)
    flat = flatten(points, triangles, found.rims)
    assert is_embedding(flat, triangles, found.rims)
    inner, outer = sorted(np.ptp(flat[rim], axis=0).mean() for rim in found.rims)
    assert 0.2 < inner / outer < 0.5


def test_a_deep_fold_falls_back_to_the_embedding_of_tutte():
    square, triangles = grid(40, 40)
    x, y = 2 * square.T - 1
    bump = 3 * np.exp(-8 * (x**2 + y**2))
    points = np.stack([x, y, bump], axis=-1)
    found, _ = topology(triangles)
    flat = flatten(points, triangles, found.rims)
    assert is_embedding(flat, triangles, found.rims)


def test_flips_and_crossings_are_seen():
    square, triangles = grid(4, 4)
    rims = topology(triangles)[0].rims
    assert is_embedding(square, triangles, rims)
    assert not is_embedding(square * [1, -1], triangles, rims)
    folded = square.copy()
    folded[12] = [2, 2]
    assert not is_embedding(folded, triangles, rims)
    # A strip that is wound around itself has no flips, but overlaps.
    strip, triangles = grid(40, 2)
    rims = topology(triangles)[0].rims
    radius, angle = 1 + 0.3 * (1 - strip[:, 1]), 7 * strip[:, 0]
    wound = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    assert not is_embedding(wound, triangles, rims)


def test_small_triangles_beside_large_ones_are_no_flips():
    square, triangles = grid(60, 10)
    radius, angle = 10 ** (-5 * square[:, 0]), np.pi / 2 * square[:, 1]
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), radius**2], axis=-1)
    rims = topology(triangles)[0].rims  # areas from 1 to 1e-10
    assert is_embedding(flatten(points, triangles, rims), triangles, rims)


def test_a_sock_is_more_than_its_rim_can_take_in():
    points, triangles = shapes.facets(16)
    with pytest.raises(FlatteningError, match="its rim is 11% of that of a flat disk"):
        flatten(points * [1, 1, 50], triangles, topology(triangles)[0].rims)


def test_a_needle_that_rounding_flips_is_told():
    square, triangles = grid(3, 3)
    points = np.column_stack([square, 0 * square[:, 0]])
    points[5] = points[6] + [1e-15, 0, 0]
    with pytest.raises(FlatteningError):
        flatten(points, triangles, topology(triangles)[0].rims)


def test_orientation_is_found_and_the_larger_part_decides():
    _, triangles = shapes.facets(6)
    mixed = triangles.copy()
    wrong = np.random.default_rng(0).random(len(mixed)) < 0.4
    mixed[wrong] = mixed[wrong][:, [1, 0, 2]]
    found, turned = topology(mixed)
    assert found.orientable and np.array_equal(turned, wrong)
    (rim,) = found.rims
    edges = {tuple(edge) for edge in np.stack([rim, np.roll(rim, -1)], axis=-1).tolist()}
    ends = {tuple(t[[i, (i + 1) % 3]].tolist()) for t in triangles for i in range(3)}
    assert edges <= ends  # the surface is on the left of its rim


def moebius(n=12):
    i = np.arange(n)
    a, b = 2 * i, 2 * i + 1
    c, d = np.roll(a, -1).copy(), np.roll(b, -1).copy()
    c[-1], d[-1] = 1, 0
    return np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)])


def torus_with_a_hole(n=5):
    i, j = np.divmod(np.arange(n * n), n)
    right, up, both = ((i + di) % n * n + (j + dj) % n for di, dj in ((1, 0), (0, 1), (1, 1)))
    a = i * n + j
    return np.concatenate([np.stack([a, right, both], -1), np.stack([a, both, up], -1)])[1:]


SQUARE = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(
    ("triangles", "said"),
    [
        (moebius(), "a surface of one side"),
        (torus_with_a_hole(), "a surface with handles (1)"),
        (np.concatenate([SQUARE, SQUARE + 4]), "2 loose parts"),
        (np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]), "three faces or more meet in 1 edges"),
        (np.array([[0, 1, 2], [1, 0, 3], [2, 1, 3], [0, 2, 3]]), "a closed surface"),
    ],
)
def test_what_is_no_disk_is_named(triangles, said):
    found, _ = topology(triangles)
    assert found.fault.startswith(said)


def test_two_fans_that_touch_in_a_vertex_are_pinched():
    bow = np.array([[0, 1, 2], [1, 3, 2], [0, 4, 5], [4, 6, 5], [1, 7, 3], [3, 7, 4], [4, 7, 6]])
    found, _ = topology(bow)
    assert found.pinched == 1 and "meet in 1 vertices alone" in found.fault


def test_points_are_merged_and_degenerate_facets_dropped():
    points, triangles = shapes.facets(4)
    soup = points[triangles].reshape(-1, 3)
    soup += 1e-9 * np.random.default_rng(0).standard_normal(soup.shape)
    loose = np.arange(len(soup)).reshape(-1, 3)
    loose = np.concatenate([loose, loose[:1], [[0, 0, 1]]])
    merged, kept = clean(np.concatenate([soup, [[9.0, 0, 0]]]), loose)
    assert len(merged) == len(points) and len(kept) == len(triangles)
    assert topology(kept)[0].fault is None
