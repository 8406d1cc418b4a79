"""What the studies of the tests are of; a module, which other processes can import."""

import os
import signal
import sys
from pathlib import Path

import ngcloth

SETTINGS = {"maxh": 1.0, "order": 2}


def dome(ks, height=0.4, then="solve", notes=None):
    """A bowl; or what users do not want."""
    if notes:
        with open(Path(notes) / "begun", "a") as file:
            file.write(f"{os.getpid()} {ks!r}\n")
    if then == "raise":
        raise RuntimeError("no such cloth")
    if then == "exit":
        sys.exit("no more cloth")
    if then == "nothing":
        return None
    if then == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    surface = ngcloth.Surface(lambda x, y: (x, y, height * (x**2 + y**2)), ngcloth.Disk())
    return ngcloth.Scene(surface, ngcloth.Net(ks=ks), [ngcloth.Elongation()], symmetric=True)


def other_cloth(fabric):
    """A flat disk in cloth that has three families, or resists bending."""
    fabrics = {
        "triaxial": ngcloth.Families((0, 60, 120)),
        "bending": ngcloth.BendingThreads(ngcloth.Net(ks=1.0), 0.1),
    }
    flat = ngcloth.Surface(lambda x, y: (x, y, 0 * x), ngcloth.Disk())
    return ngcloth.Scene(flat, fabrics[fabric])
