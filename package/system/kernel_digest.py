"""Digest of a kernel's content: of its own code and of all that it calls, so that equal sources share compiled code.

Numba compares the source file of a cached function alone, but a kernel's machine code holds that of all its callees.
The digest covers, recursively, bytecode, constants and the values of globals and closures. It covers no paths, no line
numbers, no comments and no docstrings. After the `DependenciesFinder` of Triton (Tillet et al., 2019).
"""

import dis
import enum
import functools
import hashlib
import importlib.util
import pathlib
import platform
import sys
import types
from collections.abc import Iterator
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.extending import intrinsic

_VERSIONED = {"numpy", "numba", "llvmlite"}  # named by their versions, which every digest covers
_OPAQUE = _VERSIONED | set(sys.stdlib_module_names)  # packages whose functions are named, not followed
_SETTINGS = ("BOUNDSCHECK", "OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "DEBUGINFO_DEFAULT", "FULL_TRACEBACKS")
_LOADS = tuple(dis.opmap[name] for name in ("LOAD_CONST", "RETURN_CONST") if name in dis.opmap)
_LOAD_GLOBAL = dis.opmap["LOAD_GLOBAL"]
_Intrinsic: Any = type(intrinsic(lambda typingctx: None))


class _UnknownValue(Exception):
    """A value without a representation that other processes share."""


def kernel_digest(dispatcher: Any) -> str:
    """Returns 64 hexadecimal digits that differ wherever the machine code of a kernel may.

    Where a kernel refers to a value that has no stable representation, the digest covers the sources of the package and
    of the kernel's folder instead.
    """
    try:
        content, _ = _of_dispatcher(dispatcher, ())
    except _UnknownValue:
        content = sources_digest(pathlib.Path(dispatcher.py_func.__code__.co_filename).parent)
    return _hashed(_toolchain(), content)


def signature_key(arguments: tuple[Any, ...]) -> str:
    """Returns a key of the types of a kernel's arguments: of named tuples with class and fields, unlike Numba's own."""
    return ", ".join(_type_key(each) for each in arguments)


def _type_key(kind: Any) -> str:
    if isinstance(kind, numba.types.BaseTuple):
        members: Any = kind
        named = getattr(kind, "instance_class", tuple)
        fields = getattr(named, "_fields", ())
        return f"{named.__module__}.{named.__qualname__} {fields}({signature_key(tuple(members))})"
    if isinstance(kind, numba.types.Dispatcher):
        return f"kernel {kernel_digest(kind.dispatcher)}"
    return repr(kind)


def _hashed(*parts: bytes | str) -> str:
    digest = hashlib.sha256()
    for part in parts:
        whole = part if isinstance(part, bytes) else part.encode("utf-8", "surrogatepass")
        digest.update(b"%d:" % len(whole) + whole)
    return digest.hexdigest()


@functools.cache
def _toolchain() -> str:
    """Returns the digest of what turns a kernel into machine code: versions, settings and what compiles."""
    codes = [_code_of(name) for name in ("compiled", "numba_internals")]
    settings = [f"{name}={getattr(numba.config, name, None)}" for name in _SETTINGS]
    numpys = np.__version__.split(".")[:2]  # what Numba looks at
    versions = [numba.__version__, llvmlite.__version__, *numpys, *platform.python_version_tuple()[:2]]
    return _hashed(*settings, *versions, *(part for code in codes for part in _code_parts(code)))


def _code_of(module: str) -> types.CodeType:
    """Returns the code of a module beside this one."""
    spec: Any = importlib.util.find_spec(f"{__package__}.{module}")
    code: types.CodeType = spec.loader.get_code(spec.name)
    return code


@functools.cache
def sources_digest(folder: pathlib.Path) -> str:
    """Returns the digest of the sources of the package's rooms and of a folder."""
    root = pathlib.Path(__file__).parents[1]
    rooms = [sorted(root.glob(f"{room}/**/*.py")) for room in ("system", "envs", "policies")]
    files = [*(file for room in rooms for file in room), *sorted(folder.glob("*.py"))]
    return _hashed(*(file.read_bytes() for file in files))


def _code_parts(code: types.CodeType) -> Iterator[bytes | str]:
    """Yields what a code object does, without where it stands."""
    yield code.co_code
    yield repr((code.co_name, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars))
    yield repr((code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags))
    yield code.co_exceptiontable
    loaded = set(zip(code.co_code[::2], code.co_code[1::2], strict=True))
    for place, constant in enumerate(code.co_consts):
        if isinstance(constant, types.CodeType):
            yield _hashed(*_code_parts(constant))
        elif place > 0 or not isinstance(constant, str) or any((load, 0) in loaded for load in _LOADS):
            yield _plain(constant)  # the first one is else the docstring


def _names(code: types.CodeType) -> set[str]:
    """Returns the names of globals and attributes of a code object and of those within it."""
    within = (_names(each) for each in code.co_consts if isinstance(each, types.CodeType))
    return set(code.co_names).union(*within)


def _globals(code: types.CodeType) -> set[str]:
    """Returns the names of globals alone: an attribute may be called as a function of its module is."""
    within = (_globals(each) for each in code.co_consts if isinstance(each, types.CodeType))
    loaded, extended = set(), 0
    for operation, argument in zip(code.co_code[::2], code.co_code[1::2], strict=True):  # `dis` takes ten times as long
        argument |= extended
        extended = argument << 8 if operation == dis.EXTENDED_ARG else 0
        if operation == _LOAD_GLOBAL:
            loaded.add(code.co_names[argument >> 1])
    return loaded.union(*within)


def _plain(value: Any) -> str:
    """Returns a constant's representation, with its type: 1, 1.0 and True are different constants."""
    if isinstance(value, tuple):
        return f"{type(value).__qualname__}({','.join(map(_plain, value))})"
    if isinstance(value, frozenset):
        return f"frozenset({','.join(sorted(map(_plain, value)))})"
    return f"{type(value).__qualname__} {value!r}"


# digest of each function met, unless it takes part in a recursion: its digest then depends on where that was entered
_digests: dict[int, tuple[Any, str]] = {}
_Digest = tuple[str, bool]  # a digest, and whether what it covers is recursive
_Path = tuple[int, ...]  # ids of the functions that are being digested, from the kernel on


def _of_dispatcher(dispatcher: Any, path: _Path) -> _Digest:
    options = _plain(tuple(sorted((name, str(value)) for name, value in dispatcher.targetoptions.items())))
    digest, recursive = _of_function(dispatcher.py_func, path)
    return _hashed("kernel", options, digest), recursive


def _of_function(function: types.FunctionType, path: _Path) -> _Digest:
    """Returns the digest of a function and of all that it refers to."""
    if id(function) in _digests:
        return _digests[id(function)][1], False
    if id(function) in path:
        return f"recursion {len(path) - path.index(id(function))}", True
    path = (*path, id(function))
    code = function.__code__
    parts: list[bytes | str] = [function.__module__, function.__qualname__, *_code_parts(code)]
    names = sorted(_names(code))
    refers = [(name, function.__globals__[name]) for name in sorted(_globals(code)) if name in function.__globals__]
    cells = zip(code.co_freevars, function.__closure__ or (), strict=True)
    refers += [(f"free {name}", cell.cell_contents) for name, cell in cells]
    refers += [(f"default {k}", value) for k, value in enumerate(function.__defaults__ or ())]
    recursive = False
    for name, value in refers:
        digest, cyclic = _of_value(value, names, path)
        parts += [name, digest]
        recursive |= cyclic
    digest = _hashed(*parts)
    if not recursive:
        _digests[id(function)] = function, digest
    return digest, recursive


def _of_value(value: Any, names: list[str], path: _Path) -> _Digest:
    """Returns the digest of a value that a function refers to.

    Args:
        names: those in the function's code, some of which may be attributes of the value.

    Raises:
        _UnknownValue: if it has none.
    """
    if isinstance(value, _Intrinsic):
        return _of_function(value._defn, path)
    if hasattr(value, "py_func") and hasattr(value, "targetoptions"):
        return _of_dispatcher(value, path)
    if isinstance(value, types.ModuleType):
        return _of_module(value, names, path)
    if isinstance(value, tuple):
        digests = [_of_value(each, names, path) for each in value]
        kind = _of_class(type(value))
        return _hashed(kind, *(digest for digest, _ in digests)), any(cyclic for _, cyclic in digests)
    return _hashed(_of_leaf(value)), False


def _of_module(module: types.ModuleType, names: list[str], path: _Path) -> _Digest:
    """Returns the digest of what a function may take out of a module."""
    if module.__name__.partition(".")[0] in _OPAQUE:
        return _hashed("module", module.__name__), False
    parts, recursive = ["module"], False
    for name in names:
        if name in vars(module):
            digest, cyclic = _of_value(vars(module)[name], names, path)
            parts += [name, digest]
            recursive |= cyclic
    return _hashed(*parts), recursive


def _of_leaf(value: Any) -> str:
    """Returns the representation of a value that refers to no others."""
    if value is None or isinstance(value, (enum.Enum, frozenset)) or type(value) in (bool, int, float, complex, str):
        return _plain(value)
    if isinstance(value, bytes):
        return _plain(value)
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        flags = value.flags
        layout = value.shape, flags.c_contiguous, flags.f_contiguous, flags.aligned, flags.writeable
        return f"array {value.dtype!r} {layout} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, np.generic) and not value.dtype.hasobject:
        return f"number {value.dtype!r} {value.tobytes().hex()}"
    if isinstance(value, np.dtype):
        return f"dtype {value!r}"
    if isinstance(value, numba.types.Type):
        return f"type {value!r}"
    if isinstance(value, type):
        return _of_class(value)
    module = getattr(value, "__module__", None) or type(value).__module__
    if callable(value) and module.partition(".")[0] in _OPAQUE:
        return f"function {module}.{getattr(value, '__qualname__', getattr(value, '__name__', value))}"
    raise _UnknownValue(repr(value))


def _of_class(kind: type) -> str:
    """Returns the representation of a class: of named tuples with their fields."""
    named = f"class {kind.__module__}.{kind.__qualname__}"
    if issubclass(kind, tuple):
        fields = getattr(kind, "_fields", ())
        defaults = getattr(kind, "_field_defaults", {})
        return f"{named} {fields} {[(name, _of_leaf(value)) for name, value in defaults.items()]}"
    if issubclass(kind, BaseException) or kind.__module__.partition(".")[0] in _OPAQUE:
        return named
    raise _UnknownValue(named)
