"""One at a time: NGSolve and Netgen do not bear several solves in one process, nor a fork."""

import os
import threading
from functools import wraps

_LOCK = threading.RLock()  # callbacks of a solve may solve
_user = None  # the process in which Netgen may have started threads


def alone(function):
    """Let one thread at a time run such functions; refuse in a fork of a process that has.

    Meshing starts threads that a forked process has not, and would wait for.
    """

    @wraps(function)
    def waiting(*args, **kwargs):
        global _user
        if _user not in (None, os.getpid()):
            raise RuntimeError(
                f"ngcloth.{function.__name__} cannot run in a process forked from one that has "
                "meshed already: start it by 'spawn', as with "
                "ProcessPoolExecutor(mp_context=multiprocessing.get_context('spawn'))"
            )
        with _LOCK:
            _user = os.getpid()
            return function(*args, **kwargs)

    return waiting
