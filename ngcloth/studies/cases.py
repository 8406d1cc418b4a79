"""What a study is asked for: cases and settings of plain values, checked before any is solved."""

import inspect
import json
import os
from collections.abc import Mapping
from math import isfinite

import numpy as np

from ..errors import InputError
from ..result.save import checksum
from ..scenes import hemisphere
from ..solver.settings import checked_settings
from ..solver.solve import solve
from ..version import __version__
from .source import source
from .store import COLUMNS

OWN = ("log", "callback", "checkpoint", "throw")  # settings of a solve that a study has not
VALUES = "finite numbers, texts, True, False, None, or lists and dicts of these"


def checked_cases(make_scene, cases):
    """The cases as a list of dicts of plain values.

    Raises
    ------
    InputError
        If they are no dicts, are not what `make_scene` takes, or have values that no text can keep.
    """
    allowed = "an iterable of dicts, one or more"
    if isinstance(cases, Mapping | str):
        raise InputError("cases", cases, allowed)
    try:
        cases = list(cases)
    except TypeError:
        raise InputError("cases", cases, allowed) from None
    if not cases:
        raise InputError("cases", cases, allowed)
    parameters = inspect.signature(make_scene)
    checked = []
    for number, case in enumerate(cases):
        argument = f"cases[{number}]"
        if not isinstance(case, Mapping):
            raise InputError(argument, case, "a dict, the arguments of make_scene by name")
        case = {name: plain(f"{argument}[{name!r}]", value) for name, value in case.items()}
        clash = sorted(set(case) & set(COLUMNS), key=str)
        if clash:
            allowed = f"arguments of other names: the table has a column {clash[0]!r} of its own"
            raise InputError(argument, case, allowed)
        try:
            parameters.bind(**case)
        except TypeError as error:
            allowed = f"the arguments of make_scene by name ({error})"
            raise InputError(argument, case, allowed) from None
        checked.append(case)
    return checked


def checked_study_settings(settings):
    """Settings of `solve`, plain and within bounds, as a dict.

    Raises
    ------
    InputError
        If one is none of `solve`, or cannot be the same for all cases.
    """
    parameters = inspect.signature(solve).parameters
    known = [n for n, each in parameters.items() if each.kind is not each.VAR_KEYWORD][1:]
    known = [name for name in known if name not in OWN]
    for name, value in settings.items():
        if name not in known:
            raise InputError(name, value, f"a setting of a study; there are {', '.join(known)}")
    settings = {name: plain(name, value) for name, value in settings.items()}
    checked = inspect.signature(checked_settings).parameters
    given = {name: parameters[name].default for name in list(checked)[1:]} | settings
    scene = hemisphere(ks=1.0)  # on which each setting counts
    checked_settings(scene, **{name: given[name] for name in list(checked)[1:]})
    return settings


def plain(argument, value):
    """A value as Python's own, or `InputError`; tuples remain, though JSON takes them for lists."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float) and isfinite(value):
        return value
    if isinstance(value, list):
        return [plain(argument, each) for each in value]
    if type(value) is tuple:  # a named one would lose its names
        return tuple(plain(argument, each) for each in value)
    if isinstance(value, Mapping) and all(isinstance(name, str) for name in value):
        return {name: plain(argument, each) for name, each in value.items()}
    raise InputError(argument, value, VALUES)


def keys(make_scene, cases, settings, warm):
    """Where each case is kept: a hash of all that its result follows from.

    Raises
    ------
    InputError
        If the source of `make_scene` is nowhere to be read.
    """
    common = [source(make_scene), settings, warm, __version__]
    return [checksum(json.dumps([case, *common], sort_keys=True).encode())[:32] for case in cases]
