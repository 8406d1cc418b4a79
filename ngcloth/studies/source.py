"""What the source of a function is: its own text, and that of what it calls, unless installed."""

import functools
import hashlib
import inspect
import sys
import sysconfig
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType

import numpy as np

from ..errors import InputError

INSTALLED = tuple({sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib")})
PACKAGES = {"site-packages", "dist-packages"}  # the user's own folder of packages among them
ATOMS = bool | int | float | complex | str | bytes | None | type(Ellipsis)


def source(function):
    """A text that changes with what a function does.

    It has the function, the values it is closed over, its defaults, and the functions, classes,
    modules and values that it names, and those they name; of packages that are installed, and of
    ngcloth, names alone. What is read from files, or found by name when it runs, is not seen.

    Parameters
    ----------
    function : callable
        Of the user's, or of a package.

    Returns
    -------
    str

    Raises
    ------
    InputError
        If a function of the user's has no source, as one typed in a shell.
    """
    parts = {}
    try:
        if isinstance(function, FunctionType):
            inspect.getsource(function)
        _tell(function, "make_scene", parts)
    except (OSError, TypeError) as error:
        allowed = f"a function whose source is in a file, to tell when it has changed ({error})"
        raise InputError("make_scene", function, allowed) from error
    return "\n".join(f"{place}: {text}" for place, text, _ in parts.values())


def _tell(value, place, parts):
    """Note in `parts`, by id, what a value is, and what it refers to; values live as long."""
    if isinstance(value, ATOMS):
        parts[place] = place, repr(value), None
        return
    if id(value) in parts:
        return
    parts[id(value)] = place, _text(value), value
    for name, each in _named(value):
        _tell(each, f"{place}.{name}", parts)


def _text(value):
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return f"array {value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, FunctionType | type | ModuleType) and _own(value):
        try:
            return inspect.getsource(value)
        except (OSError, TypeError):  # made by a call, as the methods of a dataclass, or compiled
            return _compiled(value.__code__) if isinstance(value, FunctionType) else value.__name__
    if isinstance(value, FunctionType | type | BuiltinFunctionType | ModuleType):
        return f"{getattr(value, '__module__', '')} {value.__name__}"
    if isinstance(value, set | frozenset):
        return repr(sorted(map(repr, value)))
    return f"{type(value).__module__} {type(value).__qualname__}"


def _named(value):
    """What a value refers to, (name, value) each."""
    if isinstance(value, FunctionType):
        if hasattr(value, "__wrapped__"):
            yield "wrapped", value.__wrapped__
        if _own(value):
            yield from inspect.getclosurevars(value).nonlocals.items()
            yield "defaults", value.__defaults__
            yield "keywords", value.__kwdefaults__
            for name in sorted(_names(value.__code__) & set(value.__globals__)):
                yield name, value.__globals__[name]
    elif isinstance(value, type):
        if _own(value):
            yield "bases", value.__bases__
            for name, each in sorted(vars(value).items()):
                if _method(each) or not name.startswith("__"):
                    yield name, each
    elif isinstance(value, ModuleType):
        if _own(value):
            for name, each in sorted(vars(value).items()):
                if isinstance(each, FunctionType | type | ModuleType) and _own(each):
                    yield name, each
    elif isinstance(value, functools.partial):
        yield from (("function", value.func), ("given", value.args), ("named", value.keywords))
    elif isinstance(value, dict):
        yield from ((repr(name), each) for name, each in value.items())
    elif isinstance(value, list | tuple):
        yield from ((str(number), each) for number, each in enumerate(value))
    elif isinstance(value, property):
        yield from (("get", value.fget), ("set", value.fset))
    elif hasattr(value, "__func__"):
        yield from (("function", value.__func__), ("of", getattr(value, "__self__", None)))
    elif not isinstance(value, set | frozenset):
        yield "class", type(value)
        yield "state", _state(value)


def _state(value):
    """What a copy of a value would be made from: not all that values hold is in a `__dict__`."""
    try:
        made = value.__reduce_ex__(2)
        return made if isinstance(made, str) else [*made[1:3], *map(list, filter(None, made[3:]))]
    except Exception:  # of any kind: there are values that cannot be copied
        return getattr(value, "__dict__", None)


def _compiled(code):
    """A text of a function that has no other."""
    inner = (_compiled(c) if isinstance(c, CodeType) else repr(c) for c in code.co_consts)
    return f"{code.co_code.hex()} {code.co_names} {', '.join(inner)}"


def _method(value):
    return isinstance(value, FunctionType | classmethod | staticmethod)


def _names(code):
    """Global names in a function's code, and in that of the functions within."""
    inner = [_names(each) for each in code.co_consts if isinstance(each, CodeType)]
    return set(code.co_names).union(*inner)


def _own(value):
    """Whether it is the user's, and may change from one day to the next."""
    name = value.__name__ if isinstance(value, ModuleType) else value.__module__ or ""
    if name.partition(".")[0] == __name__.partition(".")[0]:
        return False
    file = getattr(sys.modules.get(name), "__file__", None)
    if file is None:
        return name not in sys.builtin_module_names
    return not file.startswith(INSTALLED) and PACKAGES.isdisjoint(Path(file).parts)
