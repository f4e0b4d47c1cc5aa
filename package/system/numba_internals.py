"""Numba's private parts, all of them: how a kernel is compiled in parts, once each, and kept by content.

What this file relies on. It was tried with Numba 0.68 alone, of `constraints.txt`; others from 0.60 on are taken to
have the same parts, and the plain mode serves where one is missing at import:

* `numba.njit` takes `pipeline_class`, `no_cfunc_wrapper` and `_nrt`.
* `core.compiler.Compiler`, with its constructor, and `Flags`, with `_values`, `no_compile` and `no_cpython_wrapper`.
* `core.codegen.JITCodeLibrary`: `finalize`, `_linking_libraries`, `_optimize_final_module`, `_finalize_final_module`,
  `_finalize_dynamic_globals`, `_finalized`, `_final_module`, `_codegen._module_pass_manager`.
* `core.dispatcher.Dispatcher`: `compile`, `add_overload`, `get_call_template`, `overloads`, `targetoptions`,
  `targetctx.insert_user_function`, `_insert`, `_cache`; `_code` of types.
* `core.codegen.JITCPUCodegen`: `_get_host_cpu_name`, `_get_host_cpu_features`, `_engine._defined_symbols`; its place
  `_internal_codegen` in `core.registry.cpu_target.target_context`.
* `core.registry.cpu_target.typing_context`: `resolve_function_type`, `_lookup_global`; `types.Function`, whose key
  holds its templates.
* `core.caching`: `FunctionCache`, `CompileResultCacheImpl`, the locator of `NUMBA_CACHE_DIR`, `IndexDataCacheFile`
  with `_load_data`, `_save_data`, `_data_path`, `_dump`, `_open_for_write`; `core.runtime._nrt_python.c_helpers`, with
  the names that `core.runtime.nrt` gives them.
* `core.compiler_lock.global_compiler_lock`, `core.sigutils.normalize_signature`; `_defn` of intrinsics
  (`kernel_digest`); the names of llvmlite's callbacks.
"""

import contextlib
import functools
import gc
import hashlib
import itertools
import os
import pathlib
import pickle
import signal
import sys
import threading
from typing import Any, ClassVar

import filelock
import llvmlite.binding
import numba
import numba.core.compiler
from numba.core import caching
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target
from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]
from numba.core.sigutils import normalize_signature
from numba.cpython import hashing  # noqa: F401  # lets machine code read Python's secret of hashes

from wayfield.system.compile_notices import tell_of_compiling, tell_of_damage, tell_of_no_cache
from wayfield.system.kernel_digest import kernel_digest, signature_key
from wayfield.system.processor_level import features_of, levels

_config: Any = numba.config

# division as in IEEE; no entry for callers in C, of which there are none: it takes an eighth of the compiler's time
# `forceinline` is said for each: Numba hands it on from a caller to what it compiles for it. All that an inlined
# function calls would be put in place of every call, up to 48 times within one kernel.
_SETTINGS: Any = {"error_model": "numpy", "no_cfunc_wrapper": True, "forceinline": False, "_nrt": False}


class _OfLevel(JITCPUCodegen):
    """What makes machine code for a level of the instruction set: the same code on every processor of that level."""

    def _get_host_cpu_name(self) -> str:
        return levels()[0]

    def _get_host_cpu_features(self) -> str:
        return features_of(levels()[0])


def _use_level() -> None:
    """Makes Numba compile for the processor's level, in this process.

    No-op where NUMBA_CPU_NAME or NUMBA_CPU_FEATURES says otherwise, where there is no level, and where another package
    has compiled already: its code lies in the engine that would be exchanged.
    """
    context = cpu_target.target_context
    chosen = _config.CPU_NAME is not None or _config.CPU_FEATURES is not None
    if not chosen and levels() and not context.codegen()._engine._defined_symbols:
        context._internal_codegen = _OfLevel("wayfield")


_use_level()


def _remembering(context: Any) -> Any:
    """Returns `resolve_function_type` of a typing context that types an operator once for the types that it is put to.

    Only while a kernel of ours is compiled, and only Numba's own functions: it tries each of an operator's templates,
    those of arrays too, at every place where two numbers are added, which took an eighth of the compiler's time.
    """
    resolve = context.resolve_function_type
    signatures: dict[Any, Any] = {}

    @functools.wraps(resolve)
    def remembered(function: Any, args: Any, kws: Any) -> Any:
        own = function if isinstance(function, numba.types.Type) else context._lookup_global(function)
        if kws or _depth.now == 0 or not isinstance(own, numba.types.Function):
            return resolve(function, args, kws)
        signature = signatures.get((own, args))
        if signature is None:
            signature = resolve(function, args, kws)
            if signature is not None:
                signatures[own, args] = signature
        return signature

    return remembered


cpu_target.typing_context.resolve_function_type = _remembering(cpu_target.typing_context)


def serving_any_layout(kernel: Any) -> Any:
    """Lets a kernel serve arrays however they lie in memory: see `compiled.any_layout`."""
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


class _Part(JITCodeLibrary):
    """The code of a kernel that another one calls: never machine code of its own.

    It is left as it is written: LLVM meets it once, beside all that it calls, in the code of the outermost kernel.
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
        built = self._codegen._module_pass_manager()
        manager, *more = built if isinstance(built, tuple) else (built,)  # and what built it, since numba 0.62
        manager.run(self._final_module, *more)


def _callers_first(whole: JITCodeLibrary) -> list[Any]:
    """Returns what a kernel and its parts call, each after all that call it: LLVM links what is asked for by then."""
    met: set[Any] = set()
    ordered: list[Any] = []

    def visit(library: Any) -> None:
        for each in library._linking_libraries:
            if each not in met:
                met.add(each)
                if isinstance(each, _Part):
                    visit(each)
                ordered.append(each)

    visit(whole)
    return ordered[::-1]


class _Pipeline(Compiler):
    """Numba's compiler, which leaves a kernel that is compiled on behalf of another one as a part of it."""

    def __init__(self, typingctx: Any, targetctx: Any, library: Any, args: Any, return_type: Any, flags: Any,
                 locals: Any) -> None:  # fmt: skip
        number = next(_numbers)
        if number == _MANY:
            tell_of_compiling("some 10 to 30 s of a core")
        if _depth.now > 1:
            library = _Part(targetctx.codegen(), f"part{number}")
            flags.no_compile = flags.no_cpython_wrapper = True
        elif library is None:
            library = _Whole(targetctx.codegen(), f"whole{number}")
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
_MANY = 12  # kernels and parts that a process compiles before it says so: about a second


# what reading a damaged index, pickle or bitcode raises; a RuntimeError is LLVM's
_DAMAGED = (
    OSError, EOFError, pickle.UnpicklingError, ValueError, LookupError, TypeError, AttributeError, ImportError,
    MemoryError, OverflowError, RuntimeError,
)  # fmt: skip


_PYTHON = f"py{sys.version_info.major}{sys.version_info.minor}{getattr(sys, 'abiflags', '')}"
_PATIENCE = 30.0  # s, for which a process waits for one that compiles the same: one that has stopped is not waited for


_LOCATORS: list[Any] = list(caching.CompileResultCacheImpl._locator_classes)
_NamedFolder, _InTree = (
    next(each for each in _LOCATORS if each.__name__.strip("_") == f"{name}CacheLocator")
    for name in ("UserProvided", "InTree")
)


class _SharedFolder(_NamedFolder):  # type: ignore[misc, valid-type]
    """`NUMBA_CACHE_DIR`, by the names of packages: copies of the same sources share what one of them has compiled."""

    def __init__(self, function: Any, file: str) -> None:
        super().__init__(function, file)
        self._cache_path = str(pathlib.Path(_config.CACHE_DIR, function.__module__.rpartition(".")[0]))


class _BesideSources(_InTree):  # type: ignore[misc, valid-type]
    """Beside the source itself where the module is a link: a new editable install deletes the tree of links."""

    def __init__(self, function: Any, file: str) -> None:
        super().__init__(function, os.path.realpath(file))


class _Places(caching.CompileResultCacheImpl):
    """Where code is kept: in the shared folder if one is named, else in the first place of Numba's that is writable."""

    _locator_classes: ClassVar[Any] = [_SharedFolder, _BesideSources, *_LOCATORS]  # type: ignore[misc]


class _Files(caching.IndexDataCacheFile):
    """The files of a kernel; before the machine code stands its SHA-256, so that none runs that is damaged."""

    def _save_data(self, name: str, data: Any) -> None:
        content = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(hashlib.sha256(content).digest() + content)

    def _load_data(self, name: str) -> Any:
        content = pathlib.Path(self._data_path(name)).read_bytes()
        if hashlib.sha256(content[_DIGEST:]).digest() != content[:_DIGEST]:
            raise ValueError(f"{name} is damaged")
        return pickle.loads(content[_DIGEST:])


_DIGEST = 32  # bytes
# what `wayfield compile` put there before the wheel was made
CARRIED = pathlib.Path(__file__).parents[1] / "machine_code"


@functools.cache
def _know_helpers() -> None:
    """Lets machine code that is kept call what Numba's runtime has in C.

    Numba makes its whole compiler ready for that, which takes half a second and 50 MB; a compilation does so itself.
    """
    for name, address in _nrt_python.c_helpers.items():
        llvmlite.binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


class _Cache(caching.FunctionCache):
    """Numba's disk cache by content, and never a reason to fail: without it one waits.

    The name of a file holds the digest of the kernel and of all that it calls. Sources that are touched, installed anew
    or copied find what they had compiled, and their versions do not take each other's place in a shared folder.

    Of the processes that lack a kernel, one compiles it, and the others wait for it and load it.
    """

    def __init__(self, dispatcher: Any) -> None:
        self._dispatcher, self._py_func = dispatcher, dispatcher.py_func
        self._lock: filelock.BaseFileLock | None = None
        self._usable: bool | None = None  # None: not looked for
        self._carried: Any = None  # the files of the wheel

    @property
    def cache_path(self) -> str | None:
        """The folder of the kernel's files; None where none can be written."""
        return self._cache_path if self._has_folder() else None

    def holds_any(self) -> bool:
        """Returns whether code of the kernel is kept, for whichever arguments."""
        carried = pathlib.Path(self._named()._index_path).is_file()
        return carried or (self._has_folder() and pathlib.Path(self._cache_path, f"{self._base}.nbi").is_file())

    def _named(self) -> Any:
        """Returns the kernel's files in the wheel, or a shared folder that is read alone; makes names and digest, once.

        Not before the kernel is first compiled, since what it refers to may stand behind it in its module.
        """
        if self._carried is None:
            self._digest = kernel_digest(self._dispatcher)
            package, _, module = self._py_func.__module__.rpartition(".")
            self._kernel = f"{module}.{self._py_func.__qualname__}".replace("<", "").replace(">", "")
            self._base = f"{self._kernel}-{self._digest[:16]}.{_PYTHON}"
            shared = _config.CACHE_DIR  # a folder that others fill and nobody may change, as in a classroom
            places = [CARRIED, *([pathlib.Path(shared)] if shared and not os.access(shared, os.W_OK) else [])]
            files = [_Files(str(place / package), self._base, self._digest) for place in places]
            self._carried = next((each for each in files if pathlib.Path(each._index_path).is_file()), files[0])
        return self._carried

    def _has_folder(self) -> bool:
        """Returns whether there is a folder; looks for it once."""
        if self._usable is None:
            try:
                self._impl = _Places(self._py_func)
            except (RuntimeError, OSError) as error:  # a RuntimeError when no folder can be written
                tell_of_no_cache(f"no folder can be written ({type(error).__name__}); NUMBA_CACHE_DIR names one")
                self._usable = False
                return False
            self._named()
            self._cache_path = self._impl.locator.get_cache_path()
            self._cache_file = _Files(self._cache_path, self._base, self._digest)
            self.enable()
            self._usable = True
        return self._usable

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return signature_key(normalize_signature(sig)[0]), codegen.magic_tuple()  # what else may differ is digested

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Returns what the wheel carries or was compiled before; None where it is not to be read, or is damaged.

        Where there is nothing, and it is not a part, the lock is held from here on until `release`.
        """
        _know_helpers()
        carried = self._of_wheel(sig, target_context)
        if carried is not None or not self._has_folder():
            return carried
        overload = self._stored(sig, target_context)
        if overload is None and _depth.now == 1 and self._lock is None:
            lock = filelock.FileLock(pathlib.Path(self._cache_path, f"{self._base}.lock"))
            try:
                lock.acquire(timeout=_PATIENCE)
            except (OSError, NotImplementedError):  # no patience is left, or the folder knows no locks
                return None
            self._lock = lock
            overload = self._stored(sig, target_context)
        return overload

    def _of_wheel(self, sig: Any, target_context: Any) -> Any:
        """Returns what the wheel carries; None where that is nothing, or is damaged."""
        if not pathlib.Path(self._named()._index_path).is_file():
            return None
        try:
            overload = self._read(self._carried, sig, target_context)
        except _DAMAGED as error:
            tell_of_damage(f"{self._carried._cache_path}: {type(error).__name__}: {error}")
            return None
        return overload if overload is None or tuple(overload.signature.args) == normalize_signature(sig)[0] else None

    def _read(self, files: Any, sig: Any, target_context: Any) -> Any:
        """Returns the code of some files for the processor's level, else for a lower one; None if there is none."""
        codegen = target_context.codegen()
        arguments, (triple, name, features) = self._index_key(sig, codegen)
        own = isinstance(codegen, _OfLevel)
        for processor in [(each, features_of(each)) for each in levels()] if own else [(name, features)]:
            content = files.load((arguments, (triple, *processor)))
            if content is not None:
                return numba.core.compiler.CompileResult._rebuild(target_context, *content)
        return None

    def release(self) -> None:
        """Lets others look for what this process has compiled, or failed to."""
        lock, self._lock = self._lock, None
        if lock is not None:
            with contextlib.suppress(OSError):
                lock.release()

    def _stored(self, sig: Any, target_context: Any) -> Any:
        try:
            with self._guard_against_spurious_io_errors():
                overload = self._read(self._cache_file, sig, target_context)
            # two processes that begin together may give the code of two signatures one file, which the later one keeps
            return (
                overload if overload is None or tuple(overload.signature.args) == normalize_signature(sig)[0] else None
            )
        except _DAMAGED as error:
            tell_of_no_cache(f"{self.cache_path}: {type(error).__name__}: {error}")
            with contextlib.suppress(OSError):
                self.flush()  # what is damaged would be read again
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keeps what was compiled, if there is room and leave to."""
        if isinstance(data.library, _Part) or not self._has_folder():
            return
        try:
            super().save_overload(sig, data)
            self._prune()
        except _DAMAGED as error:  # the kernel runs all the same
            tell_of_no_cache(f"{self.cache_path}: {type(error).__name__}: {error}")

    def _prune(self) -> None:
        """Removes the kernel's older versions, where no other copy of the sources keeps its own."""
        if _config.CACHE_DIR or "locals" in self._kernel:  # of a function within another there may be several
            return
        for file in pathlib.Path(self._cache_path).glob(f"{self._kernel}-*.{_PYTHON}.*"):
            if not file.name.startswith(f"{self._base}."):
                file.unlink(missing_ok=True)


def _of_any_number(get_call_template: Any) -> Any:
    """Returns `Dispatcher.get_call_template` that compiles for whole numbers, not anew for one that is written out."""

    @functools.wraps(get_call_template)
    def called(args: Any, kws: Any) -> Any:
        return get_call_template(tuple(map(_any_number, args)), {name: _any_number(kind) for name, kind in kws.items()})

    return called


def _any_number(kind: Any) -> Any:
    """Returns the type of a whole number, within plain tuples too, for that of one whose value is known."""
    if isinstance(kind, numba.types.IntegerLiteral):
        return kind.literal_type
    if isinstance(kind, numba.types.Tuple):
        return numba.types.Tuple([_any_number(each) for each in kind])
    return kind


def cached(function: Any, **options: Any) -> Any:
    """Returns the kernel of a function with a disk cache; options as of `numba.njit`, beside those of all kernels."""
    dispatcher = numba.njit(pipeline_class=_Pipeline, **_SETTINGS | options)(function)
    dispatcher.get_call_template = _of_any_number(dispatcher.get_call_template)
    dispatcher.compile = _in_parts(dispatcher, _patient(dispatcher.compile))
    dispatcher._cache = _Cache(dispatcher)
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
        cres = cres._replace(entry_point=object())  # a name for it, which cannot be called
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


def holds_any(kernel: Any) -> bool:
    """Returns whether machine code of a kernel is kept, for whichever arguments."""
    return isinstance(kernel._cache, _Cache) and kernel._cache.holds_any()
