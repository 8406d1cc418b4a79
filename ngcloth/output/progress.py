"""A progress bar for the barrier loop: how far μ has come on its way down. Needs tqdm."""

import math
import sys


class ProgressBar:
    """A bar on log μ from the first barrier to the last, for the callback of a solve.

    It is drawn on standard error where that is a terminal; nothing is written elsewhere, nor for a
    scene without limits, which has no barrier. Beside it stands the residual, which has to fall to
    the last μ once the bar is full. Each solve begins a new bar. ::

        with ProgressBar() as bar:
            result = ngcloth.solve(scene, callback=bar, log=bar.print)

    Raises
    ------
    ImportError
        If tqdm is missing; it names the extra to install.
    """

    def __init__(self):
        try:
            from tqdm import tqdm
        except ImportError as error:
            extra = "pip install 'ngcloth[progress]', in a clone '.[progress]'"
            raise ImportError(f"a progress bar needs tqdm: {extra}", name="tqdm") from error
        self._make, self._bar = tqdm, None

    def __call__(self, result):
        """Show the last step of a solve that is running.

        Parameters
        ----------
        result : Result
            What `ngcloth.solve` calls its callback with.
        """
        rows, last_mu = result.history, result.settings.get("barrier_end")
        if last_mu is None:
            return
        if self._bar is None or len(rows) == 1:
            self._begin(math.log10(rows[0].mu / last_mu))
        row, bar = rows[-1], self._bar
        bar.n = math.log10(rows[0].mu / row.mu)
        bar.set_description_str(f"μ {row.mu:.0e}, residual {row.residual:.0e}, step {row.newton}")

    def print(self, line):
        """Print a line above the bar, for the `log` of a solve.

        Parameters
        ----------
        line : str
            Without its end.
        """
        with self._make.external_write_mode(file=sys.stdout):
            print(line, flush=True)

    def close(self):
        """Take the bar away."""
        if self._bar is not None:
            self._bar.close()
        self._bar = None

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()

    def _begin(self, decades):
        self.close()
        self._bar = self._make(
            total=decades,
            bar_format="{desc} {percentage:3.0f}% |{bar}|",
            leave=False,
            disable=None,  # unless standard error is a terminal
        )
