"""What `print(result)` says."""

import numpy as np

from ..problem.bars import with_bar
from ..problem.warp import in_words


def summary(result):
    """A result in some lines: how it ended, energy and area with bars, extrema, direction."""
    low, high = result.extrema["stretch1"]
    shear = result.largest_shear
    angle = np.degrees(np.arccos(min(shear, 1)))
    held = "chosen" if result.scene.warp is None else "given"
    evenest = "\n  one of many nets: the one that bends most evenly"
    many = evenest if result.scene.net_choice else ""
    bar, unit = result.error["energy"], result.scene.normalisation
    energy = with_bar(f"{result.normalized_energy:.6e}", bar and bar / unit)
    area = with_bar(f"{result.area:.6f}", result.error["area"])
    asked = result.settings.get("accuracy")
    short = "; one mesh, no error bar" if bar is None and result.scene.constraints else ""
    if result.falls_short:
        short += f"\n  the accuracy of {asked:g} that was asked for is not reached"
    return (
        f"{result.scene.name}: {result.why}\n"
        f"  E/(2π kc) = {energy}, patch area {area}{short}\n"
        f"  λ1 in [{low:.6f}, {high:.6f}], "
        f"|γ| up to {shear:.6f}, threads at {angle:.1f}° or more{many}\n"
        f"  warp along {in_words(result.warp)} at {in_words(result.middle[1])}, as {held}\n"
        f"  {result.newton_iterations} Newton steps, {result.seconds:.2f} s"
    )
