"""Compiled code is kept where it can be, and where it cannot nothing fails.

The tests run as root as well, whom no permission stops: an unwritable folder is simulated by one that lies below a
file, or by taking the places away in which numba looks.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from wayfield.envs.compiled import _sources
from wayfield.envs.geometry import sin_cos
from wayfield.policies.parts.stopping import free_time

KERNEL = """
from wayfield.envs.compiled import compiled, inlined

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


def called(folder: Path, before: str = "", between: str = "", **environment: str) -> list[str]:
    """Returns what a fresh interpreter prints that calls two kernels of a module in the folder: results, warnings."""
    if not (folder / "kernel.py").exists():  # written anew it would be compiled anew
        (folder / "kernel.py").write_text(KERNEL)
    paths = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", CALL.format(before=before, between=between)],
        capture_output=True, text=True, timeout=300, cwd=folder, env=os.environ | {"PYTHONPATH": paths} | environment,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_what_was_compiled_is_kept(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert called(tmp_path, NUMBA_CACHE_DIR=str(cache)) == ["6.0 8.0", ""]
    kept = {file: file.stat().st_mtime_ns for file in cache.rglob("*.nbc")}
    assert kept
    assert called(tmp_path, NUMBA_CACHE_DIR=str(cache)) == ["6.0 8.0", ""]
    assert {file: file.stat().st_mtime_ns for file in cache.rglob("*.nbc")} == kept


def test_of_processes_that_lack_a_kernel_one_compiles_it(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    told = "import kernel; kernel.four_times(1.5); print(sum(kernel.four_times.stats.cache_misses.values()), *hits())"
    code = f"hits = lambda: [sum(kernel.four_times.stats.cache_hits.values())]\n{told}"
    settings = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    words = [sys.executable, "-c", code]
    processes = [subprocess.Popen(words, cwd=tmp_path, env=settings, stdout=subprocess.PIPE) for _ in range(3)]
    found = sorted(process.communicate()[0].split() for process in processes)
    assert found == [[b"0", b"1"], [b"0", b"1"], [b"1", b"0"]]


def test_what_is_compiled_elsewhere_is_void_once_any_kernel_that_it_may_call_has_changed() -> None:
    stamped = [Path(name) for files in _sources(called) for name, *_ in files]  # of a function outside the package
    for file in (sin_cos.py_func.__code__.co_filename, free_time.py_func.__code__.co_filename, __file__):
        assert any(each.samefile(file) for each in stamped), file


def test_without_any_folder_it_is_compiled_anew_and_said_once(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    # the folders beside the module and in the user's home are taken away as well
    before = (
        "from numba.core import caching as c; own = [getattr(c, 'UserProvidedCacheLocator', None) or "
        "c._UserProvidedCacheLocator]; "  # as older releases call it
        "c.CacheImpl._locator_classes = c.CompileResultCacheImpl._locator_classes = own"
    )
    result, *said = called(tmp_path, before, NUMBA_CACHE_DIR=str(tmp_path / "file" / "cache"))
    assert result == "6.0 8.0"
    assert len(said) == 1
    assert "compiled code is not kept: no folder can be written" in said[0]


@pytest.mark.parametrize(
    ("method", "error"),
    [
        ("_save_index", "errno.ENOSPC, 'No space left on device'"),
        ("_save_data", "errno.ENOSPC, 'No space left on device'"),
        ("_save_data", "errno.EACCES, 'Permission denied'"),
        ("_load_index", "errno.EACCES, 'Permission denied'"),
    ],
)
def test_a_cache_that_fails_is_said_once(tmp_path: Path, method: str, error: str) -> None:
    between = (
        f"import errno; from numba.core.caching import IndexDataCacheFile as F\n"
        f"    def fail(*_): raise OSError({error})\n"
        f"    F.{method} = fail"
    )
    result, *said = called(tmp_path, between=between, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert result == "6.0 8.0"
    assert len(said) == 1
    assert "compiled code is not kept" in said[0]


def test_a_damaged_cache_is_compiled_anew(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    called(tmp_path, NUMBA_CACHE_DIR=str(cache))
    for pattern in ("*four_times*.nbc", "*four_times*.nbi"):
        for file in cache.rglob(pattern):
            file.write_bytes(file.read_bytes()[:40])
        result, *said = called(tmp_path, NUMBA_CACHE_DIR=str(cache))
        assert result == "6.0 8.0"
        assert len(said) == 1
        assert "compiled code is not kept" in said[0]
        # and it is mended
        assert called(tmp_path, NUMBA_CACHE_DIR=str(cache)) == ["6.0 8.0", ""]


def test_a_signal_that_comes_while_a_kernel_is_compiled_is_not_lost(tmp_path: Path) -> None:
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
    assert called(tmp_path, before.strip(), between.strip(), NUMBA_CACHE_DIR=str(cache)) == [
        "interrupted",
        "6.0 8.0",
        "",
    ]
    assert list(cache.rglob("kernel.four_times*.nbc"))


@pytest.mark.parametrize("first", ["four_times", "twice"])
def test_what_other_kernels_call_is_a_part_of_them_until_python_calls_it(tmp_path: Path, first: str) -> None:
    between = f"""
    kernel.{first}(1.5)
    print(sorted(k for k in ("twice", "four_times") if getattr(kernel, k).signatures and callable(
        next(iter(getattr(kernel, k).overloads.values())).entry_point)), kernel.twice(1.5), kernel.twice(2))
    """
    cache = tmp_path / "cache"
    callable_ones, *results = called(tmp_path, "", between.strip(), NUMBA_CACHE_DIR=str(cache))
    assert callable_ones == f"['{first}'] 3.0 4.0"
    assert results == ["6.0 8.0", ""]
    assert len(list(cache.rglob("kernel.twice*.nbc"))) == 2  # kept for those who call it from Python


def test_an_error_in_a_part_comes_out_of_it(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(
        KERNEL.replace("def twice(x):", "def twice(x):\n    if x == 1.5:\n        raise ValueError('one and a half')")
    )
    between = """
    for function in (kernel.four_times, kernel.twice):
        try:
            function(1.5)
        except ValueError as error:
            print(error)
    kernel.four_times = kernel.twice = lambda x: x
    """
    results = called(tmp_path, "", between.strip(), NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert results[:2] == ["one and a half"] * 2


@pytest.mark.parametrize("decorator", ["compiled", "inlined"])
def test_what_counts_no_references_may_not_hand_arrays_on(tmp_path: Path, decorator: str) -> None:
    (tmp_path / "kernel.py").write_text(f"""
import numpy as np
from wayfield.envs.compiled import allocating, compiled, inlined

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
    *refused, result, _ = called(tmp_path, "", between.strip(), NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    ending = "returns arrays, or calls what does: it must be decorated with allocating"
    assert refused == [f"same {ending}", f"takes {ending}"]
    assert result == "6.0 8.0"


def test_code_of_another_signature_under_ones_name_is_not_used(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    called(tmp_path, NUMBA_CACHE_DIR=str(cache))
    first, second = sorted(cache.rglob("kernel.four_times*.nbc"))
    second.write_bytes(first.read_bytes())  # as two processes leave it that save at once
    assert called(tmp_path, NUMBA_CACHE_DIR=str(cache)) == ["6.0 8.0", ""]


def test_a_kernel_without_machine_code_to_keep_runs(tmp_path: Path) -> None:
    before = """
    from llvmlite.binding import executionengine
    executionengine.ExecutionEngine._raw_object_cache_notify = None
    from numba.core.codegen import CPUCodeLibrary
    def none_yet(self):
        raise RuntimeError("no compiled object yet")
    CPUCodeLibrary._get_compiled_object = none_yet
    """
    results, told = called(tmp_path, before.strip(), NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert results == "6.0 8.0"
    assert "no compiled object yet" in told


WEIGHTED = """
from typing import Any, NamedTuple
from wayfield.envs.compiled import any_layout, compiled

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
"""
ARRAYS = """
import numpy as np
from kernel import Cloud, first_weighted, weighted
from wayfield.envs.compiled import machine_code

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
print(first_weighted(wide[:, :5].copy(), w, out) == out[0] != 0.0)
rows(weighted)
"""


def test_one_kernel_serves_arrays_of_any_layout_with_the_same_bits_and_is_kept(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(WEIGHTED)
    cache = tmp_path / "cache"
    for script, told in ((ARRAYS, ["1 1 0"]), (ARRAYS + REFUSED, ["1 0 1", "True", "True"])):
        done = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, timeout=300, cwd=tmp_path,
            env=os.environ | {"NUMBA_CACHE_DIR": str(cache)}, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert done.stdout.splitlines() == told
        assert len(list(cache.rglob("kernel.weighted*.nbc"))) == 1
