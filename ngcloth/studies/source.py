"""What the source of a function is: its own text, and that of what it calls, unless installed."""

import functools
import hashlib
import inspect
import sys
import sysconfig
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType

import numpy as np

from ..errors import InputError

INSTALLED = tuple({sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib")})
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
        _tell(function, "make_scene", parts)
    except (OSError, TypeError) as error:
        allowed = f"a function whose source is in a file, to tell when it has changed ({error})"
        raise InputError("make_scene", function, allowed) from error
    return "\n".join(f"{place}: {text}" for place, text in parts.values())


def _tell(value, place, parts):
    """Note in `parts`, by id, what a value is, and what it refers to."""
    if isinstance(value, ATOMS):
        parts[place] = place, repr(value)
        return
    if id(value) in parts:
        return
    parts[id(value)] = place, _text(value)
    for name, each in _named(value):
        _tell(each, f"{place}.{name}", parts)


def _text(value):
    if isinstance(value, np.ndarray):
        return f"array {value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, FunctionType | type | ModuleType) and _own(value):
        return inspect.getsource(value)
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
            yield from (item for item in sorted(vars(value).items()) if _method(item[1]))
    elif isinstance(value, ModuleType):
        return
    elif isinstance(value, functools.partial):
        yield from (("function", value.func), ("given", value.args), ("named", value.keywords))
    elif isinstance(value, dict):
        yield from ((repr(name), each) for name, each in value.items())
    elif isinstance(value, list | tuple):
        yield from ((str(number), each) for number, each in enumerate(value))
    elif hasattr(value, "__func__"):
        yield from (("function", value.__func__), ("of", value.__self__))
    else:
        yield "class", type(value)
        yield from sorted(getattr(value, "__dict__", {}).items())


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
    return not file.startswith(INSTALLED)
