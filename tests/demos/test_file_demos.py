"""The demos from file to pattern make the files that they say, and these are read."""

import numpy as np
import pytest

from demos import part_to_pattern, scan
from ngcloth import Surface


def test_the_hood(tmp_path):
    part_to_pattern.write_part(tmp_path / "hood.step")
    part = Surface.from_cad(tmp_path / "hood.step", "outside")
    assert len(part.topology.rims) == 2 and part.sharp == 0
    assert part.least_radius == pytest.approx(part_to_pattern.RADIUS, rel=0.03)
    assert part.area == pytest.approx(np.prod(part_to_pattern.SIZE), rel=0.04)


def test_the_scan(tmp_path):
    scan.write_scan(tmp_path / "scan.stl")
    surface = Surface.from_mesh(tmp_path / "scan.stl")
    # Of its noise in height, what is normal to the surface.
    assert 0.6 * scan.NOISE < surface.noise < scan.NOISE
    assert len(surface.topology.rims) == 1 and not surface.rough


@pytest.mark.slow
@pytest.mark.parametrize("demo", [part_to_pattern, scan])
def test_from_file_to_pattern(tmp_path, demo):
    result = demo.main(tmp_path)
    assert result.converged and result.newton_iterations <= 50
    assert list(tmp_path.glob("*.svg")) and len(list(tmp_path.glob("*.png"))) == 2
