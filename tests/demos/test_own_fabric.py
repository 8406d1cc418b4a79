"""The demo of fabrics, limits and costs of one's own."""

import pytest
from loading import load

own_fabric = load("own_fabric")


def test_each_choice_leaves_its_mark():
    results = {name: own_fabric.solve(name, maxh=0.3) for name in own_fabric.SCENES}
    assert all(result.converged for result in results.values())

    def largest(name, field):
        return results[name].extrema[field][1]

    usual = results["paper's net"]
    assert usual.normalized_energy == pytest.approx(0.898, abs=0.01)
    assert largest("warp 2, weft ½", "stretch1") < 1.5 < 1.7 < largest("warp 2, weft ½", "stretch2")
    assert largest("locking threads", "stretch1") < largest("paper's net", "stretch1") - 0.1
    assert largest("λ ≤ 1.1", "stretch1") < 1.1 + 0.02
    assert results["λ ≤ 1.1"].extrema["stretch1"][0] < 0.95  # slack threads are allowed there
    assert largest("little shear", "shear") < 0.9 * largest("paper's net", "shear")
