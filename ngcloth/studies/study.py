"""study(): many cases of a scene, in one call that can be made again."""

import multiprocessing
import os
import pickle
import sys
from collections import Counter
from time import perf_counter

from ..errors import InputError, check_integer
from ..output import table_plots
from ..result.load import load
from .cases import checked_cases, checked_study_settings, keys
from .running import run_all
from .store import RESULT, Store, checked_folder
from .task import NOT_YET, failure
from .warm import neighbours


class Study:
    """Cases of a scene, each solved once and kept in a folder.

    Parameters
    ----------
    make_scene : callable
        ``make_scene(**case)`` returns the `Scene` of a case. It is called where the case is solved,
        so scenes need not travel; for processes it has to be a function of a module, or of a
        script whose work is under ``if __name__ == "__main__":``.
    cases : iterable of dict
        Arguments of `make_scene` by name: numbers, texts, truth values, None, lists and dicts of
        these; NumPy's numbers and arrays become Python's.
    folder : path
        Where cases are kept, one folder each; made where it is missing. Several studies may share
        one, and several machines.
    executor : concurrent.futures.Executor or int, optional
        Where cases are solved: anything with such a ``submit``; or a number of processes, started
        by "spawn". By default as many as this process may use cores. Each solves with one thread.
    warm : bool, optional
        Let each case start from the nearest that is solved by then. Default False.
    part : (int, int), optional
        ``(3, 10)`` solves the third tenth of the cases, for array jobs on one folder.
    log : callable, optional
        Called with one line of text as the study begins, and after each case.
    **settings
        Of `solve`, the same for all cases.

    Raises
    ------
    InputError
        If there is no such case, setting, function or folder; before anything is solved.

    Notes
    -----
    A case is known by a hash of its values, the settings, the version of ngcloth and the source of
    `make_scene` with all that it calls of the user's own. A case that has converged, or stopped
    for a reason of the solver's, is never solved again; one that has changed is, and so is one
    that raised an error or was lost with its process. What `make_scene` reads from files is not in
    the hash. Nothing that is read from the folder is code, or a pickle.
    """

    def __init__(
        self,
        make_scene,
        cases,
        folder,
        executor=None,
        *,
        warm=False,
        part=None,
        log=None,
        **settings,
    ):
        if isinstance(make_scene, type) or not callable(make_scene):
            raise InputError("make_scene", make_scene, "a function that returns a Scene")
        if not isinstance(warm, bool):
            raise InputError("warm", warm, "True or False")
        if not (log is None or callable(log)):
            raise InputError("log", log, "a callable of one argument, or None")
        self._executor = _checked_executor(executor, make_scene)
        self._make_scene, self._log = make_scene, log
        self._settings = checked_study_settings(settings)
        self.cases = checked_cases(make_scene, cases)
        self.keys = keys(make_scene, self.cases, self._settings, warm)
        self._near = neighbours(self.cases, self.keys) if warm else {}
        self._mine = set(self.keys[_checked_part(part)])
        self._store = Store(checked_folder(folder))

    def explain(self):
        """What will be solved, what it will cost, what is done: a text of some lines.

        Where nothing is done yet, one case is solved to tell, and kept.

        Returns
        -------
        str
        """
        open_keys = self._open()
        if not any(row["seconds"] for row in self._rows()) and open_keys:
            self._run(open_keys[len(open_keys) // 2 :][:1])
            open_keys = self._open()
        rows = self._rows()
        ended = self._mine - set(open_keys)
        failed = sum(not self._row(key)["converged"] for key in ended)
        again = sum(self._row(key)["reason"] != NOT_YET for key in open_keys)
        solved = [row for row in rows if row["seconds"] is not None]
        lines = [
            f"{len(self._mine)} cases" + (f" of {len(set(self.keys))}" if self._is_part else ""),
            f"  done    {len(ended)}, of which {failed} did not converge, in {self._store.folder}",
            f"  to do   {len(open_keys)}" + (f", of which {again} failed before" if again else ""),
        ]
        if solved:
            seconds = sum(row["seconds"] for row in solved) / len(solved)
            memory = max(row["memory"] or 0 for row in solved)
            total = seconds * len(open_keys)
            lines.append(f"  each    {seconds:.2g} s on one core, {memory / 1e6:.2g} MB")
            workers = self._executor if isinstance(self._executor, int) else None
            where = f", {_time(total / workers)} on {workers} processes" if workers else ""
            lines.append(f"  in all  {_time(total)} of one core{where}; told by {len(solved)}")
        return "\n".join(lines)

    def run(self):
        """Solve what is not done, and write the table.

        Returns
        -------
        Study
            This one.

        Raises
        ------
        OSError
            If the folder cannot be written to.
        BrokenExecutor
            If an executor of yours gives up; call again with a new one.
        RuntimeError
            If worker processes end before they begin.
        """
        try:
            self._run(self._open())
        finally:
            self._store.write_table(self.table)
        return self

    @property
    def table(self):
        """One row a case, in their order, from what is in the folder: a list of dicts.

        The key under which it is kept, inputs, and `converged`, `reason`, `energy`,
        `normalized_energy`, `area`, their error bars where there are any, extrema, Newton `steps`,
        `certified` and, if not, `faults`, `memory` (an estimate, in bytes) and `seconds` (all that
        the case took). A case that failed has a reason and None for what it has not.
        """
        kept = {key: self._row(key) for key in dict.fromkeys(self.keys)}
        rows = zip(self.keys, self.cases, strict=True)
        return [{"key": key} | case | kept[key] for key, case in rows]

    def load(self, number):
        """The result of a case.

        Parameters
        ----------
        number : int
            Of the case, from 0.

        Returns
        -------
        Result

        Raises
        ------
        InputError
            If it has none.
        """
        number = check_integer("number", number, 0, len(self.cases) - 1)
        folder = self._store.place(self.keys[number]) / RESULT
        if not folder.is_dir():
            reason = self._row(self.keys[number])["reason"]
            raise InputError("number", number, f"a case that has a result ({reason})")
        return load(folder, self._make_scene(**self.cases[number]))

    def to_pandas(self):
        """The table as a pandas DataFrame; needs pandas."""
        import pandas

        return pandas.DataFrame(self.table)

    def to_xarray(self):
        """The table as an xarray Dataset along "case"; needs xarray."""
        return self.to_pandas().rename_axis("case").to_xarray()

    def scatter(self, x, y, colour=None, ax=None):
        """Draw two columns against each other, see `ngcloth.output.table_plots.scatter`."""
        return table_plots.scatter(self.table, x, y, colour, ax)

    def parallel_coordinates(self, columns, ax=None):
        """Draw a line a case, see `ngcloth.output.table_plots.parallel_coordinates`."""
        return table_plots.parallel_coordinates(self.table, columns, ax)

    @property
    def _is_part(self):
        return len(self._mine) < len(set(self.keys))

    def _open(self):
        """Keys of what is to be solved, in the order of the cases."""
        unique = dict.fromkeys(key for key in self.keys if key in self._mine)
        return [key for key in unique if not self._store.finished(key)]

    def _row(self, key):
        record = self._store.record(key)
        return record["row"] if record else failure(NOT_YET)

    def _rows(self):
        return [self._row(key) for key in self._mine]

    def _run(self, chosen):
        cases = dict(zip(self.keys, self.cases, strict=True))
        tasks = {
            key: (
                self._make_scene,
                cases[key],
                self._settings,
                str(self._store.folder),
                key,
                tuple(self._near.get(key, ())),
            )
            for key in chosen
        }
        if tasks:
            run_all(tasks, self._store, self._executor, _Progress(len(tasks), self._log))


def study(make_scene, cases, folder, executor=None, **settings):
    """Solve many cases of a scene, each once, whatever happens on the way.

    Called again after it was cut off, or with other cases, it solves what is missing.

    Parameters
    ----------
    make_scene : callable
        ``make_scene(**case)`` returns the `Scene` of a case.
    cases : iterable of dict
        Arguments of `make_scene` by name.
    folder : path
        Where cases and the table, ``study.csv``, are kept.
    executor : concurrent.futures.Executor or int, optional
        Where cases are solved; by default on all cores.
    **settings
        Of `solve`, and ``warm``, ``part`` and ``log`` of `Study`, which tells more.

    Returns
    -------
    Study
        With its `table`: one row a case, failed ones included.

    Raises
    ------
    InputError
        If there is no such case, setting, function or folder; before anything is solved.
    """
    return Study(make_scene, cases, folder, executor, **settings).run()


class _Progress:
    """Lines of a study that runs."""

    def __init__(self, total, log):
        self._total, self._log, self._begun = total, log, perf_counter()
        self._count = Counter()
        if log:
            log(f"{total} to solve")

    def __call__(self, key, row):
        self._count[bool(row["converged"])] += 1
        done = self._count.total()
        if self._log:
            left = (perf_counter() - self._begun) / done * (self._total - done)
            failed = f", {self._count[False]} of them failed" if self._count[False] else ""
            self._log(f"{done} of {self._total} solved{failed}, {_time(left)} left")


def _checked_executor(executor, make_scene):
    """The executor, or the number of processes."""
    allowed = "an Executor of concurrent.futures, or a number of processes"
    if executor is None:
        executor = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 0
        executor = executor or os.cpu_count() or 1
    if not isinstance(executor, int):
        if isinstance(executor, type) or not callable(getattr(executor, "submit", None)):
            raise InputError("executor", executor, allowed)
        return executor
    check_integer("executor", executor, 1)
    allowed = "a function of a module, which other processes can import"
    try:
        pickle.dumps(make_scene)
    except Exception as error:
        raise InputError("make_scene", make_scene, f"{allowed} ({error})") from error
    main = sys.modules["__main__"]
    if getattr(make_scene, "__module__", None) == "__main__" and not hasattr(main, "__file__"):
        raise InputError("make_scene", make_scene, f"{allowed}, not typed in a shell")
    if multiprocessing.current_process().daemon:
        raise InputError("executor", executor, "an Executor: this process may not start others")
    return executor


def _checked_part(part):
    """A part of a list as a slice."""
    if part is None:
        return slice(None)
    if not isinstance(part, tuple | list) or len(part) != 2:
        raise InputError("part", part, "a pair (k, n), for the k-th of n parts")
    total = check_integer("part", part[1], 1)
    return slice(check_integer("part", part[0], 1, total) - 1, None, total)


def _time(seconds):
    """A time to read."""
    for unit, size in (("h", 3600), ("min", 60)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
