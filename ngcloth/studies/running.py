"""Run all cases on an executor, whatever becomes of its workers."""

import multiprocessing
import os
import signal
import threading
from collections import Counter
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager

from .task import failure, solve_case

TRIES = 2  # alone, before a case is to blame: memory may have been short for a moment
FALSE_STARTS = 2
LOST = "lost: it takes down the process that solves it"
GUARD = (
    "worker processes end before they begin a case: they import the script that is run, so its "
    "own work has to be under `if __name__ == '__main__':`, and make_scene above that"
)


def run_all(tasks, store, executor, done):
    """Run tasks, in any order.

    Parameters
    ----------
    tasks : dict
        Arguments of `solve_case` by key.
    store : Store
        To which they write.
    executor : Executor or int
        Where to run them; or how many processes to start for them, which are made anew where one
        is lost. The tasks that were begun then run one at a time, to see which of them it was.
    done : callable
        ``done(key, row)`` after each.

    Raises
    ------
    BrokenExecutor
        If an executor of the user's gives up.
    RuntimeError
        If processes end before they begin.
    """
    store.clear(tasks)
    if not isinstance(executor, int):
        if _together(tasks, store, executor, done):
            raise BrokenExecutor(
                "the executor has lost a worker and takes no more cases; what is solved is kept. "
                "Call again with a new one, or with executor=None, which finds the case it was"
            )
        return
    suspects, tries, false_starts = {}, Counter(), 0
    while tasks:
        chosen = suspects or tasks
        with processes(1 if suspects else min(executor, len(tasks))) as pool:
            left = _together(chosen, store, pool, done)
        begun = store.begun() & left.keys()
        store.clear(begun)
        false_starts = 0 if begun or len(left) < len(chosen) else false_starts + 1
        if false_starts == FALSE_STARTS:
            raise RuntimeError(GUARD)
        tries.update(begun if suspects else ())
        for key in (key for key in begun if tries[key] == TRIES):
            done(key, lost(left.pop(key), store, LOST))
        tasks = {key: task for key, task in tasks.items() if key in left or key not in chosen}
        suspects = left if suspects else {key: left[key] for key in begun if key in left}


def _together(tasks, store, executor, done):
    """Run tasks at once; those that were not as the executor broke."""
    futures, left = {}, dict(tasks)
    try:
        for key, task in tasks.items():
            futures[executor.submit(solve_case, *task)] = key
    except BrokenExecutor:
        pass
    try:
        for future in as_completed(futures):
            key = futures[future]
            try:
                row = future.result()
            except BrokenExecutor:
                record = store.record(key)  # it may have been lost on its way home
                if record is None:
                    continue
                row = record["row"]
            except Exception as error:
                row = lost(tasks[key], store, f"{type(error).__name__}: {error}")
            del left[key]
            done(key, row)
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    return left


def lost(task, store, why):
    """Keep the row of a case that was not left to its end."""
    _, case, settings, _, key, *_ = task
    row = failure(why)
    with store.workshop(key) as place:
        told = {"case": case, "settings": settings, "finished": False, "row": row}
        store.write_record(place, key, told)
    return row


@contextmanager
def processes(number):
    """An executor of so many processes, none of which outlives this one, be it killed."""
    context = multiprocessing.get_context("spawn")
    life, ours = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(number, context, _begin, (life,))
    try:
        yield pool
        pool.shutdown()
    finally:
        ours.close()
        pool.shutdown(wait=False, cancel_futures=True)
        life.close()


def _begin(life):
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the master's to hear
    threading.Thread(target=_follow, args=(life,), daemon=True).start()


def _follow(life):
    """End this process when the master has: its end of the pipe is closed then."""
    try:
        life.recv()
    except (EOFError, OSError):
        os._exit(1)
