"""The demos of fabrics from tests."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from loading import load

import ngcloth
from ngcloth.chebyshev import ChebyshevNet
from ngcloth.scenes import hemisphere

real_cloth = load("real_cloth")


def test_from_a_csv_to_a_draped_part(tmp_path):
    """The law comes back from the files, and threads on the part stay within the tests."""
    demo = load("measured_fabric")
    demo.write_records(tmp_path)
    cloth = demo.fabric(tmp_path)
    gamma = np.linspace(0, np.sin(np.radians(55)), 200)
    force = demo.shear_force(gamma)
    assert np.abs(cloth.curves["shear"].force(gamma) - force).max() < 0.02 * force.max()
    plt.close(cloth.plot()[0].figure)
    result = demo.solve(cloth, maxh=12.0)
    assert result.converged and result.newton_iterations <= 100
    assert 25 < np.degrees(np.arcsin(result.extrema["shear"][1])) < 35
    assert result.extrema["stretch1"][1] < cloth.longest("warp")


def test_angles_are_those_of_the_exact_net():
    net = ChebyshevNet.symmetric(hemisphere().surface)
    result = ngcloth.solve(hemisphere(), maxh=0.3, order=6)
    largest, mean = real_cloth.angle_error(result, net)
    assert largest < 2e-2 and mean < largest / 3


@pytest.mark.parametrize("ratio", [1e-4, 1e-6])
def test_the_locking_curve_is_free_and_then_stiff(ratio):
    shear = real_cloth.locking(ratio).curves["shear"]
    free, locked = np.sin(np.radians([25, 50]))
    slope = [(shear.force(s + 1e-3) - shear.force(s - 1e-3)) / 2e-3 for s in (free, locked)]
    assert slope[0] < 3e-3 and slope[1] == pytest.approx(2.0, rel=0.03)
