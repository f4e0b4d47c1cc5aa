"""How every kernel of the project is compiled.

`numba_internals` compiles it in parts, so that LLVM meets each once, and keeps it by content; it relies on private
parts of Numba. The plain mode uses public options of Numba alone and gives the same bits: where WAYFIELD_PLAIN_JIT=1
says so, where the installed Numba is newer than those tested, and where one of its private parts is missing.
"""

import ast
import contextlib
import functools
import inspect
import os
import pathlib
import tempfile
import textwrap
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numba
import numpy as np

from wayfield.system.compile_notices import tell_of_no_cache
from wayfield.system.kernel_digest import sources_digest

_config: Any = numba.config
if _config.DISABLE_JIT:
    raise ImportError("NUMBA_DISABLE_JIT is set, and nothing of wayfield runs without compiled kernels: unset it")
_TESTED = (0, 69)  # Numba before this version; the bound of pyproject.toml


def _why_plain() -> str:
    """Returns why Numba's private parts are not used; "" where they are."""
    if os.environ.get("WAYFIELD_PLAIN_JIT", "0") not in ("", "0"):
        return "WAYFIELD_PLAIN_JIT"
    version = tuple(int(part) for part in numba.__version__.split(".")[:2] if part.isdigit())
    if version >= _TESTED:
        return f"Numba {numba.__version__} is newer than those tested"
    try:
        import wayfield.system.numba_internals  # noqa: F401
    except (ImportError, AttributeError, TypeError) as error:  # a part was moved or removed
        return f"Numba {numba.__version__} lacks what they rely on ({error})"
    return ""


_PLAIN = _why_plain()
if _PLAIN:  # laws handed to a step as constants: Numba compiles such kernels in every process, and says so of each
    warnings.filterwarnings("ignore", "Cannot cache compiled function", numba.NumbaWarning)
# a record of teams begins as one of goals does, and a kernel made for that takes it as it is
warnings.filterwarnings("ignore", r"Record\(.* has been considered a subtype", numba.NumbaWarning)
if _PLAIN not in ("", "WAYFIELD_PLAIN_JIT"):
    warnings.warn(f"wayfield compiles kernels in the plain mode, slower: {_PLAIN}", RuntimeWarning, stacklevel=2)


def compiled(function: Any) -> Any:
    """Compiles a scalar function of one robot, or a loop over robots, to machine code, and caches it on disk.

    IEEE arithmetic as it is written, without fastmath: a lone robot, a batch, and another day give the same bits. It
    lets other threads of Python run: none may write what it is given.

    It makes no arrays and returns none, and so counts no references to them, which takes two atomic operations wherever
    an array is named: as long as all the rest of a robot's step, and longer for threads, which wait for each other.

    Raises:
        TypeError: when it is compiled, if it returns arrays, or calls what does; ask for `allocating` then.
    """
    return _made(function, nogil=True)


def inlined(function: Any) -> Any:
    """Compiles like `compiled` and puts the code in place of each call: arrays are expensive arguments."""
    return _made(function, forceinline=True)


def allocating(function: Any) -> Any:
    """Compiles like `compiled` what makes or returns arrays: the outermost function, which calls what does the work."""
    return _made(function, nogil=True, _nrt=True)


def flattened(make: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Compiles, by `compiled` or `allocating`, a function of records for Python to hand their fields one by one.

    A record is a named tuple that a parameter is annotated with. For Python to hand a kernel six of them takes 3.7 us,
    and their fields 1 us: as long as a robot's step. The kernel that is returned has a parameter for each field, by its
    name, in order.

    A field is put where the function reads it of its record, and the record is made where it is handed on whole: to
    make each in front counts references to arrays that nobody takes, and takes a tenth of a step.

    Raises:
        TypeError: if the function gives a value of its own the name of a field.
    """

    def made(function: Any) -> Any:
        records = {name: kind for name, kind in function.__annotations__.items() if hasattr(kind, "_fields")}
        code = ast.parse(textwrap.dedent(inspect.getsource(function)))
        body: Any = code.body[0]
        names = [each.arg for each in body.args.args]
        fields = [field for name in names for field in getattr(records.get(name), "_fields", (name,))]
        for node in ast.walk(code):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in fields:
                raise TypeError(f"{function.__name__} sets {node.id}, which is a field of what it is handed")
        body.args.args = [ast.arg(field) for field in fields]
        body.decorator_list = []
        ast.increment_lineno(_Fields(records).visit(code), function.__code__.co_firstlineno - 1)
        flat: dict[str, Any] = {}
        exec(
            compile(ast.fix_missing_locations(code), function.__code__.co_filename, "exec"), function.__globals__, flat
        )
        return make(flat[function.__name__])

    return made


class _Fields(ast.NodeTransformer):
    """Puts fields in the place of their records, by the names of those."""

    def __init__(self, records: Mapping[str, Any]) -> None:
        self.records = records

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if isinstance(node.value, ast.Name) and node.value.id in self.records:
            return ast.copy_location(ast.Name(node.attr, node.ctx), node)
        return self.generic_visit(node)

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if node.id not in self.records:
            return node
        record = self.records[node.id]
        return ast.copy_location(ast.parse(f"{record.__name__}({', '.join(record._fields)})", mode="eval").body, node)


def _made(function: Any, **options: Any) -> Any:
    if _PLAIN:
        return _plain(function)
    from wayfield.system.numba_internals import cached

    return cached(function, **options)


def _plain(function: Any) -> Any:
    """Returns a kernel compiled with public options alone.

    Numba's own cache looks at the kernel's file alone: the folder is named by the digest of all sources.
    """
    folder = _plain_folder(pathlib.Path(function.__code__.co_filename).parent)
    with _cache_folder(folder):
        return numba.njit(nogil=True, error_model="numpy", cache=folder is not None)(function)


@contextlib.contextmanager
def _cache_folder(folder: pathlib.Path | None) -> Iterator[None]:
    """Makes Numba keep in a folder what is decorated within."""
    before = _config.CACHE_DIR
    _config.CACHE_DIR = str(folder or before)
    try:
        yield
    finally:
        _config.CACHE_DIR = before


@functools.cache
def _plain_folder(sources: pathlib.Path) -> pathlib.Path | None:
    """Returns the folder for plain kernels of a folder of sources; None where none can be written."""
    home = pathlib.Path(_config.CACHE_DIR or pathlib.Path(__file__).parent / "__pycache__")
    folder = home / f"plain-{sources_digest(sources)[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        tell_of_no_cache(f"no folder can be written ({type(error).__name__}); NUMBA_CACHE_DIR names one")
        return None
    return folder


def any_layout(kernel: Any) -> Any:
    """Lets a compiled kernel serve arrays however they lie in memory, with the same machine code.

    The columns of an observation lie apart for a batch, and for one robot, whose rows have no distance, side by side:
    Numba would compile a law for each, and again for each mixture of both. It is compiled for arrays whose elements may
    lie apart, and run as it is where they do not; the bits are the same. For what takes long to compile, and as long
    for a robot that finding the elements is nothing beside it. Called by another kernel it is compiled for what that
    hands it. The plain mode compiles for each layout.
    """
    if _PLAIN:
        return kernel
    from wayfield.system.numba_internals import serving_any_layout

    return serving_any_layout(kernel)


def machine_code(function: Any, *arguments: Any) -> Callable[..., int]:
    """Returns what a compiled function runs for arguments of these types, compiling it if need be.

    For arguments whose types never change: numba's dispatcher takes longer to look at a batch's arrays than one robot
    takes to step.
    """
    if _PLAIN:
        plain: Callable[..., int] = function
        return plain
    code: Callable[..., int] = function.compile(tuple(_type_of(argument) for argument in arguments))
    return code


_types: dict[tuple[Any, ...], Any] = {}


def _type_of(argument: Any) -> Any:
    """Returns `numba.typeof`, which builds the type of a record anew each time: most of what making a world takes."""
    if not isinstance(argument, np.ndarray):
        return numba.typeof(argument)
    flags = argument.flags
    layout = flags.c_contiguous, flags.f_contiguous, flags.aligned, flags.writeable
    kind = argument.dtype, argument.dtype.isalignedstruct, argument.ndim, layout
    if kind not in _types:
        _types[kind] = numba.typeof(argument)
    return _types[kind]


def is_stored(kernel: Any) -> bool:
    """Returns whether an earlier process has kept machine code of a kernel."""
    if _PLAIN:
        return any(pathlib.Path(kernel.stats.cache_path or "").glob(f"*.{kernel.py_func.__name__}-*.nbi"))
    from wayfield.system.numba_internals import holds_any

    return holds_any(kernel)


@inlined
def assign(to: Any, source: Any) -> None:
    """Copies an array, number by number, into another of its shape, which lies elsewhere.

    What Numba makes of `to[:] = source`, with a copy in between in case they overlap and the words of the error in case
    their shapes differ, takes seconds to compile.
    """
    for at in np.ndindex(source.shape):
        to[at] = source[at]
