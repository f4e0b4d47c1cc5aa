"""Compiled code is kept where it can be, and where it cannot nothing fails.

The tests run as root as well, whom no permission stops: an unwritable folder is simulated by one that lies below a
file, or by taking the places away in which numba looks.
"""

import contextlib
import inspect
import json
import os
import pkgutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import wayfield.envs
import wayfield.policies
from wayfield.system.compiled import compiled, flattened
from wayfield.system.kernel_digest import kernel_digest

KERNEL = """
from wayfield.system.compiled import compiled, inlined

@inlined
def twice(x):
    return 2.0 * x

@compiled
def four_times(x):
    return 2.0 * twice(x)
"""
CALL = """
import warnings
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    {before}
    import kernel
    {between}
    print(kernel.four_times(1.5), kernel.four_times(2))
    print(*(w.message for w in caught if "wayfield" in str(w.message)), sep="\\n")
"""


# Numba and its compiler take longer to load than all that is tried with them: each interpreter is a copy of one that
# has loaded them, and has compiled no kernel.
LOADED = """
import json, os, sys, traceback
import numba, wayfield.system.compiled
numba.njit(lambda x: 2 * x)(1.5)
for line in sys.stdin:
    folder, cache, code = json.loads(line)
    with open("told", "w") as told, open("errors", "w") as errors:
        copy = os.fork()
        if copy == 0:
            os.dup2(told.fileno(), 1)
            os.dup2(errors.fileno(), 2)
            os.chdir(folder)
            sys.path.insert(0, folder)
            os.environ["NUMBA_CACHE_DIR"] = numba.config.CACHE_DIR = cache
            try:
                exec(code, {"__name__": "__main__"})
            except BaseException:
                traceback.print_exc()
                os._exit(1)
            sys.stdout.flush()
            os._exit(0)
        print(os.waitpid(copy, 0)[1], flush=True)
"""
Run = Callable[[Path, Path, str], list[str]]
Called = Callable[..., list[str]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """Returns what runs code, in a folder and with one for kernels, in a fresh interpreter and returns its output."""
    home = tmp_path_factory.mktemp("loaded")
    process = subprocess.Popen(
        [sys.executable, "-c", LOADED], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=home
    )
    assert process.stdin is not None
    assert process.stdout is not None
    asked, answers = process.stdin, process.stdout

    def ran(folder: Path, cache: Path, code: str) -> list[str]:
        print(json.dumps([str(folder), str(cache), code]), file=asked, flush=True)
        assert answers.readline() == "0\n", (home / "errors").read_text()
        return (home / "told").read_text().splitlines()

    with process:
        yield ran
        asked.close()


@pytest.fixture
def called(run: Run, tmp_path: Path) -> Called:
    """Returns what calls two kernels of a module in the folder and returns results and warnings."""

    def ran(before: str = "", between: str = "", cache: str = "cache") -> list[str]:
        if not (tmp_path / "kernel.py").exists():  # written anew it would be compiled anew
            (tmp_path / "kernel.py").write_text(KERNEL)
        return run(tmp_path, tmp_path / cache, CALL.format(before=before, between=between))

    return ran


def test_what_was_compiled_is_kept(called: Called, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert called() == ["6.0 8.0", ""]
    kept = {file: file.stat().st_mtime_ns for file in cache.rglob("*.nbc")}
    assert kept
    assert called() == ["6.0 8.0", ""]
    assert {file: file.stat().st_mtime_ns for file in cache.rglob("*.nbc")} == kept


def test_of_processes_that_lack_a_kernel_one_compiles_it(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    told = "import kernel; kernel.four_times(1.5); print(sum(kernel.four_times.stats.cache_misses.values()), *hits())"
    code = f"hits = lambda: [sum(kernel.four_times.stats.cache_hits.values())]\n{told}"
    settings = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    words = [sys.executable, "-c", code]
    processes = [subprocess.Popen(words, cwd=tmp_path, env=settings, stdout=subprocess.PIPE) for _ in range(2)]
    found = sorted(process.communicate()[0].split() for process in processes)
    assert found == [[b"0", b"1"], [b"1", b"0"]]


# a kernel that refers to all that it may: functions and numbers of its module and of others, by name and by attribute
CALLER = """
import numpy as np
import other
from other import Pair, half
from wayfield.system.compiled import compiled

FIRST = 1.0  # {comment}

def first():  # no kernel calls it, though one reads an attribute of its name
    raise NotImplementedError

TABLE = np.array([2.0, 3.0])

def closed(number):
    @compiled
    def plus(x):
        return x + number
    return plus

plus = closed({cell})

@compiled
def kernel(x):
    \"\"\"{comment}\"\"\"
    return half(x) + other.third(x) + FIRST + TABLE[1] + Pair(1.0, 2.0).first + plus(x) + later(x)

@compiled
def later(x):
    return {later} * x
"""
CALLED = """
from typing import NamedTuple
from wayfield.system.compiled import inlined

class Pair(NamedTuple):
    {fields}: float

WEIGHT = {weight}

@inlined
def deep(x):
    return WEIGHT * x

@inlined
def half(x):
    return deep(x)

@inlined
def third(x):
    # {comment}
    return x / {third}

@inlined
def unused(x):
    return {unused} * x
"""
WRITTEN = {
    "comment": "as it was",
    "cell": "5.0",
    "later": "2.0",
    "fields": "first: float; second",
    "weight": "0.5",
    "third": "3.0",
    "unused": "1.0",
}


CHANGES: list[tuple[dict[str, str], int]] = [
    ({"comment": "another\n    # comment, of more lines"}, 0),
    ({"unused": "7.0"}, 0),
    ({"weight": "0.25"}, 1),
    ({"weight": "'half'[0] == 'h'"}, 1),
    ({"third": "4.0"}, 1),
    ({"cell": "6.0"}, 1),
    ({"later": "3.0"}, 1),
    ({"fields": "second: float; first"}, 1),
]


def test_a_kernel_is_compiled_anew_where_what_it_calls_has_changed_and_only_there(run: Run, tmp_path: Path) -> None:
    code = "import caller; value = caller.kernel(6.0); print(sum(caller.kernel.stats.cache_misses.values())); "
    code += "print(value, caller.kernel.py_func(6.0))"
    changed = [(WRITTEN | changes, misses) for changes, misses in CHANGES]
    for told, wanted in ((WRITTEN, 1), *changed, (WRITTEN, 0), (changed[-1][0], 0)):
        comment = told["comment"]
        (tmp_path / "caller.py").write_text(CALLER.format(**told | {"comment": comment.replace("\n    #", "")}))
        (tmp_path / "other.py").write_text(CALLED.format(**told))
        found, values = run(tmp_path, tmp_path / "cache", "import sys; sys.dont_write_bytecode = True\n" + code)
        assert int(found) == wanted, told
        assert len({float(value) for value in values.split()}) == 1


FIELDS = """
import sys; sys.dont_write_bytecode = True
import {module}, law
print(law.kernel({module}.Pair(1.0, 2.0)), sum(law.kernel.stats.cache_misses.values()))
"""


def test_the_fields_of_an_argument_belong_to_what_is_kept(run: Run, tmp_path: Path) -> None:
    law = "from wayfield.system.compiled import compiled\n\n@compiled\ndef kernel(pair):\n    return pair.a - pair.b\n"
    (tmp_path / "law.py").write_text(law)
    for module, fields, told in (("one", "ab", "-1.0 1"), ("one", "ba", "1.0 1"), ("two", "ab", "-1.0 1")):
        pair = "from typing import NamedTuple\n\nclass Pair(NamedTuple):\n"
        pair += f"    {fields[0]}: float\n    {fields[1]}: float\n"
        (tmp_path / f"{module}.py").write_text(pair)
        assert run(tmp_path, tmp_path / "cache", FIELDS.format(module=module)) == [told]


OVERLOADED = """
import numba.extending
from wayfield.system.compiled import compiled

def positive(x):
    return x > 0

@numba.extending.overload(positive)
def positive_compiled(x):
    return lambda x: x > {bound}

@compiled
def kernel(x):
    return positive(x)
"""


def test_a_kernel_that_calls_what_cannot_be_followed_depends_on_all_sources(run: Run, tmp_path: Path) -> None:
    code = "import sys; sys.dont_write_bytecode = True; import caller; "
    code += "print(caller.kernel(1.5), sum(caller.kernel.stats.cache_misses.values()))"
    for bound, told in ((0, "True 1"), (0, "True 0"), (2, "False 1")):
        (tmp_path / "caller.py").write_text(OVERLOADED.format(bound=bound))
        assert run(tmp_path, tmp_path / "cache", code) == [told]


def test_no_kernel_of_the_package_depends_on_all_sources() -> None:
    kernels: dict[int, Any] = {}
    for room in (wayfield.envs, wayfield.policies):
        for found in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            with contextlib.suppress(ModuleNotFoundError):  # of an extra
                there = vars(import_module(found.name)).values()
                kernels |= {id(each): each for each in there if hasattr(each, "targetoptions")}
    alike: dict[str, list[str]] = {}
    for each in kernels.values():
        alike.setdefault(kernel_digest(each), []).append(each.py_func.__qualname__)
    # those that do have one digest, that of the sources
    assert len(alike) > 300
    assert [names for names in alike.values() if len(names) > 1] == []


def test_without_any_folder_it_is_compiled_anew_and_said_once(called: Called, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "__pycache__").touch()  # beside the module
    before = f"import os; os.environ['HOME'] = os.environ['XDG_CACHE_HOME'] = '{tmp_path}/file/home'"
    # and not again by a process that this one starts
    child = "import os, sys; os.system(f'{sys.executable} -c \"import kernel; kernel.four_times(1.5)\" 2>&1')"
    result, *said = called(before, f"kernel.four_times(1.5); {child}", cache="file/cache")
    assert result == "6.0 8.0"
    assert len(said) == 1
    assert "compiled code is not kept: no folder can be written" in said[0]


@pytest.mark.parametrize(
    ("method", "error"),
    [
        ("_save_index", "errno.ENOSPC, 'No space left on device'"),
        ("_open_for_write", "errno.ENOSPC, 'No space left on device'"),
        ("_open_for_write", "errno.EACCES, 'Permission denied'"),
        ("_load_index", "errno.EACCES, 'Permission denied'"),
    ],
)
def test_a_cache_that_fails_is_said_once(called: Called, method: str, error: str) -> None:
    between = (
        f"import errno; from numba.core.caching import IndexDataCacheFile as F\n"
        f"    def fail(*_): raise OSError({error})\n"
        f"    F.{method} = fail"
    )
    result, *said = called(between=between)
    assert result == "6.0 8.0"
    assert len(said) == 1
    assert "compiled code is not kept" in said[0]


def test_a_damaged_cache_is_compiled_anew(called: Called, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    called()
    for pattern, flipped in (("*four_times*.nbc", False), ("*four_times*.nbc", True), ("*four_times*.nbi", False)):
        for file in cache.rglob(pattern):
            content = file.read_bytes()
            middle = len(content) // 2  # which still unpickles
            other = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
            file.write_bytes(other if flipped else content[:40])
        result, *said = called()
        assert result == "6.0 8.0"
        assert len(said) == 1
        assert "compiled code is not kept" in said[0]
        # and it is mended
        assert called() == ["6.0 8.0", ""]


def test_a_signal_that_comes_while_a_kernel_is_compiled_is_not_lost(called: Called, tmp_path: Path) -> None:
    """It comes where it would be lost: as LLVM calls back with the machine code."""
    before = """
    import signal
    from llvmlite.binding import executionengine
    find = executionengine.ExecutionEngine._find_module_ptr
    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        return find(*arguments)
    """
    between = """
    executionengine.ExecutionEngine._find_module_ptr = interrupted
    try:
        kernel.four_times(1.5)
    except KeyboardInterrupt:
        print("interrupted")
    executionengine.ExecutionEngine._find_module_ptr = find
    """
    cache = tmp_path / "cache"
    assert called(before.strip(), between.strip()) == [
        "interrupted",
        "6.0 8.0",
        "",
    ]
    assert list(cache.rglob("kernel.four_times*.nbc"))


@pytest.mark.parametrize("first", ["four_times", "twice"])
def test_what_other_kernels_call_is_a_part_of_them_until_python_calls_it(
    called: Called, tmp_path: Path, first: str
) -> None:
    between = f"""
    kernel.{first}(1.5)
    print(sorted(k for k in ("twice", "four_times") if getattr(kernel, k).signatures and callable(
        next(iter(getattr(kernel, k).overloads.values())).entry_point)), kernel.twice(1.5), kernel.twice(2))
    """
    cache = tmp_path / "cache"
    callable_ones, *results = called("", between.strip())
    assert callable_ones == f"['{first}'] 3.0 4.0"
    assert results == ["6.0 8.0", ""]
    assert len(list(cache.rglob("kernel.twice*.nbc"))) == 2  # kept for those who call it from Python


@pytest.mark.parametrize("decorator", ["compiled", "inlined"])
def test_what_counts_no_references_may_not_hand_arrays_on(called: Called, tmp_path: Path, decorator: str) -> None:
    (tmp_path / "kernel.py").write_text(f"""
import numpy as np
from wayfield.system.compiled import allocating, compiled, inlined

@{decorator}
def same(x):
    return x, 1.0

@allocating
def two(x):
    return np.full(2, 1.0 * x)

@{decorator}
def takes(x):
    return two(x)[0] + two(x)[1]

@allocating
def doubled(x):
    return two(x)[0] + two(x)[1]

def four_times(x):
    return 2 * doubled(x)
""")
    between = """
    import numpy as np
    for function, value in ((kernel.same, np.zeros(2)), (kernel.takes, 1.5)):
        try:
            function(value)
        except TypeError as error:
            print(error)
    """
    *refused, result, _ = called("", between.strip())
    ending = "returns arrays, or calls what does: it must be decorated with allocating"
    assert refused == [f"same {ending}", f"takes {ending}"]
    assert result == "6.0 8.0"


def test_code_of_another_signature_under_ones_name_is_not_used(called: Called, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    called()
    first, second = sorted(cache.rglob("kernel.four_times*.nbc"))
    second.write_bytes(first.read_bytes())  # as two processes leave it that save at once
    assert called() == ["6.0 8.0", ""]


WEIGHTED = """
import numba
from typing import Any, NamedTuple
from wayfield.system.compiled import any_layout, compiled

class Cloud(NamedTuple):
    points: Any
    weights: Any

@any_layout
@compiled
def weighted(cloud, out):
    for i in range(cloud.points.shape[0]):
        out[i] = 0.0
        for k in range(cloud.points.shape[1]):
            out[i] += cloud.points[i, k] * cloud.weights[k]

@compiled
def first_weighted(points, weights, out):
    weighted(Cloud(points, weights), out)
    return out[0]

@numba.njit
def last_weighted(points, weights, out):
    weighted(Cloud(points, weights), out)
    return out[-1]
"""
ARRAYS = """
import numpy as np
from kernel import Cloud, first_weighted, last_weighted, weighted
from wayfield.system.compiled import machine_code

wide, w, out = np.random.default_rng(0).normal(size=(12, 14)), np.linspace(0.1, 0.9, 5), np.empty(12)
given = [wide[:, :5].copy(), wide[:, :5].copy(order="F"), wide[:, :5], wide[:, ::3], wide[::-1, 5:10], wide[:1, :5]]
given = [(each, weights) for each in given for weights in (w, w[::-1])]
def rows(call):
    for points, weights in given:
        call(Cloud(points, weights), out)
        for row, found in zip(points, out):
            total = 0.0
            for a, b in zip(row, weights):
                total += a * b
            assert total == found
rows(weighted)
compile, weighted.compile = weighted.compile, None  # whoever comes again does not come to Python
rows(weighted)
weighted.compile = compile
rows(lambda *arrays: machine_code(weighted, *arrays)(*arrays))
rows(weighted)
stats = weighted.stats
print(len(weighted.overloads), sum(stats.cache_misses.values()), sum(stats.cache_hits.values()))
"""
REFUSED = """
out.flags.writeable = False
try:
    weighted(Cloud(wide[:, :5], w), out)
except Exception as error:
    print("readonly" in str(error))
out = np.empty(12)
# for who calls it compiled, it is compiled with what that hands it; the last one is none of ours, for which it is kept
print(first_weighted(wide[:, :5].copy(), w, out) == out[0] != 0.0)
print(last_weighted(wide[:, :5].copy(), w, out) == out[-1] != 0.0)
rows(weighted)
"""


def test_one_kernel_serves_arrays_of_any_layout_with_the_same_bits_and_is_kept(run: Run, tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(WEIGHTED)
    for script, told, kept in ((ARRAYS, ["1 1 0"], 1), (ARRAYS + REFUSED, ["1 0 1", "True", "True", "True"], 2)):
        assert run(tmp_path, tmp_path / "cache", script) == told
        assert len(list((tmp_path / "cache").rglob("kernel.weighted*.nbc"))) == kept


def test_a_flat_kernel_takes_the_fields_of_its_records_and_does_what_the_function_of_records_does() -> None:
    reach, twist = np.arange(3.0), np.arange(3.0) - 7.0
    assert apart(2.0, reach, 4.0, twist) == 2.0 * 4.0 * reach[1] + twist.sum() + reach.sum() + twist[2] * 4.0
    assert list(inspect.signature(apart.py_func).parameters) == ["scale", "reach", "gain", "twist"]
    with pytest.raises(TypeError, match="sets gain, which is a field"):
        flattened(compiled)(of_its_own)


class Law(NamedTuple):
    """A record of two fields, and one that a function hands on whole."""

    reach: Any
    gain: float


class Motion(NamedTuple):
    """A record of one."""

    twist: Any


@compiled
def total(law: Law, motion: Motion) -> Any:
    return motion.twist.sum() + law.reach.sum() + motion.twist[2] * law.gain


@flattened(compiled)
def apart(scale: float, law: Law, motion: Motion) -> Any:
    """Reads fields and hands records on."""
    return scale * law.gain * law.reach[1] + total(law, motion)


def of_its_own(law: Law) -> Any:
    """Gives a number of its own the name of a field."""
    gain = 2.0
    return gain * law.gain
