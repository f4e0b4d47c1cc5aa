"""How every kernel of the project is compiled."""

import contextlib
import functools
import gc
import itertools
import pathlib
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from typing import Any

import filelock
import numba
import numba.core.compiler
import numpy as np
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.sigutils import normalize_signature

# division as in IEEE; no entry for callers in C, of which there are none: it takes an eighth of the compiler's time
_SETTINGS: Any = {"error_model": "numpy", "no_cfunc_wrapper": True}
_UNCOUNTED: Any = _SETTINGS | {"_nrt": False}
_COUNTED: Any = _SETTINGS | {"_nrt": True}  # said, for otherwise a kernel takes after the first that calls it


@functools.cache
def _stamps(folder: pathlib.Path, files: str) -> tuple[tuple[str, int, int], ...]:
    """Returns what tells whether a source file of the folder, of those that the pattern fits, has changed."""
    return tuple((str(path), path.stat().st_mtime_ns, path.stat().st_size) for path in sorted(folder.glob(files)))


def _sources(function: Any) -> tuple[tuple[tuple[str, int, int], ...], ...]:
    """Returns the stamps of all that a function may call: of envs, and of its own room of the package.

    A function from elsewhere may call the laws too, and what lies in its own folder.
    """
    package, *_ = here = __name__.split(".")[:-1]
    room = function.__module__.split(".")[:2]
    envs = _stamps(pathlib.Path(__file__).parent, "**/*.py")
    if room == here:
        return (envs,)
    if room[0] == package:
        return envs, _stamps(pathlib.Path(sys.modules[".".join(room)].__file__ or "").parent, "**/*.py")
    policies = _stamps(pathlib.Path(__file__).parents[1] / "policies", "**/*.py")
    return envs, policies, _stamps(pathlib.Path(function.__code__.co_filename).parent, "*.py")


def compiled(function: Any) -> Any:
    """Compiles a scalar function of one robot, or a loop over robots, to machine code, and caches it on disk.

    IEEE arithmetic as it is written, without fastmath: a lone robot, a batch, and another day give the same bits. It
    lets other threads of Python run: none may write what it is given.

    It makes no arrays and returns none, and so counts no references to them, which takes two atomic operations wherever
    an array is named: as long as all the rest of a robot's step, and longer for threads, which wait for each other.

    Raises:
        TypeError: when it is compiled, if it returns arrays, or calls what does; ask for `allocating` then.
    """
    return _cached(numba.njit(nogil=True, pipeline_class=_Pipeline, **_UNCOUNTED)(function))


def inlined(function: Any) -> Any:
    """Compiles like `compiled` and puts the code in place of each call: arrays are expensive arguments."""
    return _cached(numba.njit(forceinline=True, pipeline_class=_Pipeline, **_UNCOUNTED)(function))


def allocating(function: Any) -> Any:
    """Compiles like `compiled` what makes or returns arrays: the outermost function, which calls what does the work."""
    return _cached(numba.njit(nogil=True, pipeline_class=_Pipeline, **_COUNTED)(function))


def any_layout(kernel: Any) -> Any:
    """Lets a compiled kernel serve arrays however they lie in memory, with the same machine code.

    The columns of an observation lie apart for a batch, and for one robot, whose rows have no distance, side by side:
    Numba would compile a law for each, and again for each mixture of both. It is compiled for arrays whose elements may
    lie apart, and run as it is where they do not; the bits are the same. For what takes long to compile, and as long
    for a robot that finding the elements is nothing beside it. Called by another kernel it is compiled for what that
    hands it.
    """
    compile_for, get_call_template, served = kernel.compile, kernel.get_call_template, set()

    @functools.wraps(compile_for)
    def compile_for_any(sig: Any) -> Any:
        arguments = normalize_signature(sig)[0]
        if _depth.called > 0:
            return compile_for(sig)
        apart = tuple(_apart(each) for each in arguments)
        code = compile_for(apart)
        if arguments != apart and arguments not in served:
            kernel._insert([each._code for each in arguments], code)  # found from here on without coming to this
            served.add(arguments)
        return code

    @functools.wraps(get_call_template)
    def called(args: Any, kws: Any) -> Any:
        _depth.called += 1
        try:
            return get_call_template(args, kws)
        finally:
            _depth.called -= 1

    kernel.compile, kernel.get_call_template = compile_for_any, called
    return kernel


def _apart(kind: Any) -> Any:
    """Returns a type of Numba's with arrays, within tuples too, whose elements may lie apart."""
    if isinstance(kind, numba.types.Array):
        return kind.copy(layout="A") if kind.ndim > 0 else kind
    if isinstance(kind, numba.types.BaseTuple):
        members: Any = kind
        named = getattr(kind, "instance_class", None)
        return numba.types.BaseTuple.from_types([_apart(each) for each in members], named)
    return kind


def machine_code(function: Any, *arguments: Any) -> Callable[..., int]:
    """Returns what a compiled function runs for arguments of these types, compiling it if need be.

    For arguments whose types never change: numba's dispatcher takes longer to look at a batch's arrays than one robot
    takes to step.
    """
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


class _Part(JITCodeLibrary):
    """The code of a kernel that another one calls: never machine code of its own.

    It is left as it is written: LLVM meets it once, beside all that it calls, in the code of whom Python calls.
    """

    def finalize(self) -> None:
        """Ends the code; what it calls is left for the whole to link."""
        called, self._linking_libraries = self._linking_libraries, []
        super().finalize()
        self._linking_libraries = called

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _Whole(JITCodeLibrary):
    """The code of a kernel that Python calls, with that of all parts.

    Each is linked once and optimized once: to link and optimize what is called at every step on the way up took half of
    the compiler's time, and gave slower loops.
    """

    def finalize(self) -> None:
        """Links the parts, optimizes all, and makes machine code of it."""
        self._linking_libraries = _callers_first(self)
        super().finalize()

    def _optimize_final_module(self) -> None:
        found = self._codegen._module_pass_manager()
        manager, *more = found if isinstance(found, tuple) else (found,)  # and what built it, since numba 0.62
        manager.run(self._final_module, *more)


def _callers_first(whole: JITCodeLibrary) -> list[Any]:
    """Returns what a kernel and its parts call, each after all that call it: LLVM links what is asked for by then."""
    met: set[Any] = set()
    found: list[Any] = []

    def visit(library: Any) -> None:
        for each in library._linking_libraries:
            if each not in met:
                met.add(each)
                if isinstance(each, _Part):
                    visit(each)
                found.append(each)

    visit(whole)
    return found[::-1]


class _Pipeline(Compiler):
    """Numba's compiler, which leaves a kernel that is compiled on behalf of another one as a part of it."""

    def __init__(self, typingctx: Any, targetctx: Any, library: Any, args: Any, return_type: Any, flags: Any,
                 locals: Any) -> None:  # fmt: skip
        if _depth.now > 1:
            library = _Part(targetctx.codegen(), f"part{next(_numbers)}")
            flags.no_compile = flags.no_cpython_wrapper = True
        elif library is None:
            library = _Whole(targetctx.codegen(), f"whole{next(_numbers)}")
            library.enable_object_caching()
        super().__init__(typingctx, targetctx, library, args, return_type, Flags(flags), locals)


class Flags(numba.core.compiler.Flags):
    """Numba's settings of a compilation, which it looks up at every operator: compared at once where they are alike.

    Option by option, as Numba does it, this took a tenth of its time. The name goes into those of the machine code.
    """

    __slots__ = ()
    _HASH = hash(numba.core.compiler.Flags())  # of the names of the options alone

    def __hash__(self) -> int:
        return self._HASH

    def __eq__(self, other: object) -> bool:
        alike = self is other or (isinstance(other, Flags) and self._values == other._values)
        return alike or bool(super().__eq__(other))


class _Depth(threading.local):
    """How many kernels of ours this thread is compiling, one within another."""

    now = 0
    called = 0  # how many, of those that serve any layout, because another one calls them, not Python


_depth = _Depth()
_numbers = itertools.count()


# what reading a damaged index, pickle or bitcode raises; a RuntimeError is LLVM's
_DAMAGED = (
    OSError, EOFError, pickle.UnpicklingError, ValueError, LookupError, TypeError, AttributeError, ImportError,
    MemoryError, OverflowError, RuntimeError,
)  # fmt: skip


_PATIENCE = 30.0  # s, for which a process waits for one that compiles the same: one that has stopped is not waited for


class _Cache(FunctionCache):
    """Numba's disk cache, void once a source file has changed, and never a reason to fail: without it one waits.

    Numba looks for changes in the file of a cached function alone, but a kernel holds the code of all it calls: without
    the stamp a kernel could go on running what its neighbour files said before an update.

    Of the processes that lack a kernel, one compiles it, and the others wait for it and load it.
    """

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file._source_stamp = (self._cache_file._source_stamp, *_sources(function))
        self._lock: filelock.BaseFileLock | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Returns what was compiled before; None where it is not to be read, or is damaged.

        Where there is nothing, and it is not a part, the lock is held from here on until `release`.
        """
        found = self._kept(sig, target_context)
        if found is None and _depth.now == 1 and self._lock is None:
            lock = filelock.FileLock(pathlib.Path(self.cache_path, f"{self._impl.filename_base}.lock"))
            try:
                lock.acquire(timeout=_PATIENCE)
            except (OSError, NotImplementedError):  # no patience is left, or the folder knows no locks
                return None
            self._lock = lock
            found = self._kept(sig, target_context)
        return found

    def release(self) -> None:
        """Lets others look for what this process has compiled, or failed to."""
        lock, self._lock = self._lock, None
        if lock is not None:
            with contextlib.suppress(OSError):
                lock.release()

    def _kept(self, sig: Any, target_context: Any) -> Any:
        try:
            found = super().load_overload(sig, target_context)
            # two processes that begin together may give the code of two signatures one file, which the later one keeps
            return found if found is None or tuple(found.signature.args) == normalize_signature(sig)[0] else None
        except _DAMAGED as error:
            _warn(f"{self.cache_path}: {type(error).__name__}: {error}")
            with contextlib.suppress(OSError):
                self.flush()  # what is damaged would be read again
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keeps what was compiled, if there is room and leave to."""
        if isinstance(data.library, _Part):
            return
        try:
            super().save_overload(sig, data)
        except _DAMAGED as error:  # the kernel runs all the same
            _warn(f"{self.cache_path}: {type(error).__name__}: {error}")


def _cached(dispatcher: Any) -> Any:
    """Returns the dispatcher with a disk cache where there is a folder for it, as it is otherwise."""
    dispatcher.compile = _in_parts(dispatcher, _patient(dispatcher.compile))
    try:
        dispatcher._cache = _Cache(dispatcher.py_func)
    except (RuntimeError, OSError) as error:  # a RuntimeError when no folder can be written
        _warn(f"no folder can be written ({type(error).__name__}); NUMBA_CACHE_DIR names one")
    return dispatcher


def _in_parts(dispatcher: Any, compile_for: Any) -> Any:
    """Returns `Dispatcher.compile` that leaves what other kernels call as parts of them, which Python cannot call."""
    add_overload = dispatcher.add_overload

    def add(cres: Any) -> None:
        if not dispatcher.targetoptions["_nrt"]:
            _check_counts(dispatcher.py_func.__name__, cres)
        if not isinstance(cres.library, _Part):
            add_overload(cres)
            return
        cres = cres._replace(entry_point=object())  # a name for it, that nobody can call
        dispatcher.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [cres.library])
        dispatcher.overloads[tuple(cres.signature.args)] = cres

    @functools.wraps(compile_for)
    def compile_in_parts(sig: Any) -> Any:
        arguments = normalize_signature(sig)[0]
        with global_compiler_lock:  # another thread may be about to put the part into its kernel
            _depth.now += 1
            collecting = _depth.now == 1 and gc.isenabled()
            if collecting:
                gc.disable()  # what the compiler makes lives until it is done: to look for waste takes a fifth of it
            try:
                there = dispatcher.overloads.get(arguments)
                if _depth.now == 1 and there is not None and isinstance(there.library, _Part):
                    del dispatcher.overloads[arguments]
                return compile_for(sig)
            finally:
                _depth.now -= 1
                if collecting:
                    gc.enable()
                if _depth.now == 0 and isinstance(dispatcher._cache, _Cache):
                    dispatcher._cache.release()

    dispatcher.add_overload = add
    return compile_in_parts


def _check_counts(name: str, cres: Any) -> None:
    """Raises TypeError if what counts no references hands some on, or is handed some: they would be counted wrong."""
    returned = [cres.signature.return_type]
    if not isinstance(cres.type_annotation, str):  # what comes out of the cache was looked at before
        typemap = cres.type_annotation.typemap
        for call, signature in cres.type_annotation.calltypes.items():
            if getattr(call, "op", "") == "call" and isinstance(typemap[call.func.name], numba.types.Dispatcher):
                returned.append(signature.return_type)
    if any(_holds_arrays(each) for each in returned):
        raise TypeError(f"{name} returns arrays, or calls what does: it must be decorated with allocating")


def _holds_arrays(kind: Any) -> bool:
    """Returns whether values of a type of Numba's are arrays or hold some."""
    members: Any = kind if isinstance(kind, numba.types.BaseTuple) else ()
    return isinstance(kind, numba.types.Array) or any(_holds_arrays(each) for each in members)


_CALLBACKS = ("_raw_object_cache_notify", "_raw_object_cache_getbuffer")  # llvmlite's, into which LLVM calls back


def _patient(compile_for: Any) -> Any:
    """Returns `Dispatcher.compile` that loses no signal.

    Python runs the handler of a signal that came while LLVM worked in the first Python code after it, which is LLVM's
    callback with the machine code. No exception gets out of there: Ctrl-C would be lost, and the machine code with it.
    A signal that meets the callback therefore waits until the kernel is compiled.
    """

    @functools.wraps(compile_for)
    def compile_patiently(sig: Any) -> Any:
        if threading.current_thread() is not threading.main_thread():  # which alone has signals
            return compile_for(sig)
        handlers: dict[int, Any] = {}
        late: list[int] = []

        def caught(number: int, frame: Any) -> None:
            within = frame
            while within is not None and within.f_code.co_name not in _CALLBACKS:
                within = within.f_back
            if within is not None:
                late.append(number)
            else:
                handlers[number](number, frame)

        for watched in (signal.SIGINT, signal.SIGTERM):
            if callable(handler := signal.getsignal(watched)):
                handlers[watched] = handler
                signal.signal(watched, caught)
        try:
            return compile_for(sig)
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
            for number in late:
                handlers[number](number, None)

    return compile_patiently


@functools.cache
def _warned() -> list[str]:
    """Returns what has been said in this process."""
    return []


def _warn(problem: str) -> None:
    """Says once in a process that compiled code is not kept."""
    if not _warned():
        _warned().append(problem)
        warnings.warn(
            f"wayfield compiles anew in every process, some seconds: compiled code is not kept: {problem}",
            RuntimeWarning,
            stacklevel=4,
        )


@inlined
def assign(to: Any, source: Any) -> None:
    """Copies an array, number by number, into another of its shape, which lies elsewhere.

    What Numba makes of `to[:] = source`, with a copy in between in case they overlap and the words of the error in case
    their shapes differ, takes seconds to compile.
    """
    for at in np.ndindex(source.shape):
        to[at] = source[at]
