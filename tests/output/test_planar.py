"""Plane geometry of outlines, held to closed forms and to Shapely."""

import numpy as np
import pytest
import shapely

from ngcloth.output.planar import Room, chords, crossing

U_SHAPE = np.array([[0, 0], [9, 0], [9, 5], [6, 5], [6, 2], [3, 2], [3, 5], [0, 5]], float)
TURNS = np.linspace(0, 7.5, 200)  # more than once around
SPIRAL = np.stack([np.cos(TURNS), np.sin(TURNS)], axis=-1)
WOUND = np.concatenate([2 * SPIRAL, SPIRAL[::-1]])  # covers a ring, and a part of it twice


def wedge(degrees, length=100.0):
    """A triangle with a tip of so many degrees at the origin."""
    half = np.radians(degrees) / 2
    end = length * np.array([np.cos(half), np.sin(half)])
    return np.array([[0, 0], end * [1, -1], end])


@pytest.mark.parametrize("outline", [U_SHAPE, WOUND, wedge(50)])
@pytest.mark.parametrize("axis", [0, 1])
def test_chords_fill_what_the_outline_covers(outline, axis):
    low, high = outline[:, 1 - axis].min(), outline[:, 1 - axis].max()
    n = 400
    levels = low + (high - low) * (np.arange(n) + 0.5) / n
    found = np.array(chords(outline, levels, axis))
    assert np.ptp(found[:, :, 1 - axis], axis=1).max() == 0
    covered = shapely.Polygon(outline)
    if outline is WOUND:
        covered = shapely.Polygon(2 * SPIRAL).buffer(0) - shapely.Polygon(SPIRAL).buffer(0)
    assert shapely.covers(covered.buffer(1e-3), shapely.linestrings(found)).all()
    area = np.ptp(found[:, :, axis], axis=1).sum() * (high - low) / n
    assert area == pytest.approx(covered.area, rel=5e-3)


@pytest.mark.parametrize(("level", "count"), [(1, 1), (2, 1), (3, 2)])
def test_chords_through_corners_and_along_sides(level, count):
    assert len(chords(U_SHAPE, [level], 0)) == count


def test_crossings_are_those_that_shapely_finds():
    rng = np.random.default_rng(1)
    stars = []
    for spread in np.linspace(0, 0.5, 40):
        t = 2 * np.pi * (np.arange(30) + spread * rng.normal(size=30)) / 30
        r = 1 + 0.5 * rng.random(30)
        stars.append(r[:, None] * np.stack([np.cos(t), np.sin(t)], axis=-1))
    found = [crossing(star) is not None for star in stars]
    assert found == [not shapely.LinearRing(star).is_simple for star in stars]
    assert {*found} == {True, False}


def test_sides_in_one_line_do_not_meet():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    sides = [
        np.linspace(*side, 9)[:-1] for side in zip(square, np.roll(square, -1, 0), strict=True)
    ]
    assert crossing(np.concatenate(sides)) is None
    touching = np.array([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]], float)
    assert crossing(touching) is not None


@pytest.mark.parametrize("outline", [10 * U_SHAPE, wedge(60), wedge(5)])
def test_the_widest_circle_is_that_of_shapely(outline):
    widest = shapely.maximum_inscribed_circle(shapely.Polygon(outline), tolerance=1e-4)
    assert Room(outline, 0.1).radii.max() == pytest.approx(widest.length, abs=2e-3)


def test_nearest_place_of_a_depth():
    square = np.array([[0, 0], [10, 0], [10, 10], [0, 10]], float)
    room = Room(square, 0.05)
    np.testing.assert_allclose(room.nearest([0, 4], 2), [2, 4], atol=0.03)
    np.testing.assert_allclose(room.nearest([0, 0], 2), [2, 2], atol=0.03)
    np.testing.assert_allclose(room.nearest([0, 4], 7), [5, 5], atol=0.01)  # there is no such depth


@pytest.mark.parametrize(("degrees", "narrow"), [(30, False), (24, False), (22, True), (5, True)])
def test_long_tips_are_narrow(degrees, narrow):
    assert (Room(wedge(degrees), 0.5).narrowest(2.0) is not None) == narrow


@pytest.mark.parametrize(("width", "narrow"), [(2.1, False), (1.9, True)])
def test_strips_and_necks_are_narrow(width, narrow):
    strip = np.array([[0, 0], [40, 0], [40, width], [0, width]], float)
    half = width / 2
    right = np.array([[2, -half], [2, -9], [20, -9], [20, 9], [2, 9], [2, half]])
    for outline in (strip, np.concatenate([right, -right])):
        assert (Room(outline, 0.5).narrowest(2.0) is not None) == narrow
