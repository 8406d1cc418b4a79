"""Run a task of `_kernel` in a process of its own."""

import subprocess
import sys
from pathlib import Path

import numpy as np

SCRIPT = Path(__file__).with_name("_kernel.py")


class KernelError(Exception):
    """A task that found its input wanting, crashed, or took too long; its text says which."""


def run(task, folder, seconds=None, **arguments):
    """Run a task, and return its answer.

    Parameters
    ----------
    task : str
        The name of a function in `_kernel`.
    folder : Path
        Where the task finds files, and leaves them.
    seconds : float, optional
        End it after so long.
    **arguments
        Arrays, numbers or texts.

    Returns
    -------
    dict of ndarray

    Raises
    ------
    KernelError
        If there is no answer.
    """
    np.savez(folder / "arguments.npz", **arguments)
    command = [sys.executable, str(SCRIPT), task, str(folder)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=seconds, errors="replace")
    except subprocess.TimeoutExpired:
        raise KernelError(f"no end after {seconds:.0f} s") from None
    if done.returncode < 0:
        raise KernelError(f"it brings down its reader (signal {-done.returncode})")
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:]
        raise KernelError(" ".join(last) or f"exit status {done.returncode}")
    with np.load(folder / "answer.npz") as answer:
        return dict(answer)
