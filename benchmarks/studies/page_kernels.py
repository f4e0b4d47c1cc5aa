"""Builds the kernels of the page: python benchmarks/studies/page_kernels.py

The compiled functions of environments and policies become one WebAssembly module, by llvmlite's own backend and the
linker of the package ziglang (extra `wasm`, for developers). With it goes what the page hands them, see `recipes`. Both
ship with the package; tests hold that they drive as Python does, bit for bit, with the gains and agents of today.
"""

import importlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
from page_recipes import Leaf, exports, jobs, tables

import wayfield
from wayfield.benchmarks import report
from wayfield.benchmarks.report.page import MODULE, TABLES
from wayfield.system.command_line import OneLineErrors
from wayfield.system.extras import installs
from wayfield.system.storage import write_whole

TRIPLE = "wasm32-unknown-unknown"
LAYOUT = "e-m:e-p:32:32-p10:8:8-p20:8:8-i64:64-i128:128-n32:64-S128-ni:1:10:20"
STACK = 1 << 20  # bytes


def adapter(kernel: Any, names: Sequence[Leaf], values: tuple[Any, ...]) -> tuple[Any, list[str]]:
    """Returns a C function that calls a compiled one on bare pointers, and the meaning of its arguments in order.

    An array is a pointer and its lengths as int32, a number a float64.
    """
    import numpy as np

    numba: Any = importlib.import_module("numba")
    types = numba.types
    from_dtype = numba.from_dtype

    kinds: list[Any] = []
    order: list[str] = []
    room: dict[str, Any] = {"carray": numba.carray, "kernel": kernel}

    def taken(name: str, value: Any) -> str:
        k = len(kinds)
        if not isinstance(value, np.ndarray):
            kinds.append(types.float64)
            order.append(name)
            return (
                f"a{k}" if isinstance(value, float) else f"int(a{k})" if not isinstance(value, bool) else f"a{k} != 0.0"
            )
        kinds.append(types.CPointer(from_dtype(value.dtype)))
        kinds.extend([types.int32] * value.ndim)
        order.extend([name, *(f"{name}#{j}" for j in range(value.ndim))])
        shape = ", ".join(f"a{k + 1 + j}" for j in range(value.ndim))
        return f"carray(a{k}, ({shape},))"

    passed = []
    left = list(names)
    for value in values:
        if isinstance(value, tuple):
            parts = [taken(*left.pop(0)) for _ in value]
            room[type(value).__name__] = type(value)
            passed.append(f"{type(value).__name__}({', '.join(parts)})")
        else:
            passed.append(taken(*left.pop(0)))
    arguments = ", ".join(f"a{k}" for k in range(len(kinds)))
    exec(f"def entry({arguments}):\n    kernel({', '.join(passed)})\n", room)
    return numba.cfunc(types.void(*kinds), error_model="numpy")(room["entry"]), order


def code_of(kernel: Any, names: Sequence[Leaf], values: tuple[Any, ...], name: str) -> tuple[str, list[str]]:
    """Returns LLVM's code of a compiled function behind a C function `entry_NAME`, for WebAssembly, and its arguments.

    Numba keeps no code of what it read from its cache: that has to be empty.
    """
    function, order = adapter(kernel, names, values)
    text = function.inspect_llvm()
    text = re.sub(r'target triple = ".*"', f'target triple = "{TRIPLE}"', text)
    text = re.sub(r'target datalayout = ".*"', f'target datalayout = "{LAYOUT}"', text)
    text = text.replace("= common ", "= internal ")
    text = re.sub(r"@llvm\.x86\.atomic\.(add|sub)\.cc\.i64", r"@count_\1", text)
    # what belongs to an intrinsic does not to a function of its name
    text = re.sub(r"^declare .*@count_(add|sub)\(.*$", r"declare i8 @count_\1(ptr, i64, i32)", text, flags=re.MULTILINE)
    return text.replace(function.native_name, f"entry_{name}"), order


def object_of(text: str, name: str) -> bytes:
    """Returns the WebAssembly object code of LLVM's code, in which only the entry is seen from outside."""
    import llvmlite.binding as llvm

    module = llvm.parse_assembly(text)
    module.verify()
    for each in module.functions:
        if not each.is_declaration and each.name != f"entry_{name}":
            each.linkage = "internal"
    for variable in module.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"
    machine = llvm.Target.from_triple(TRIPLE).create_target_machine(opt=3)
    code: bytes = machine.emit_object(module)
    return code


def built(folder: Path) -> tuple[bytes, dict[str, list[str]]]:
    """Returns the module, and the arguments of each of its functions in order."""
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    orders: dict[str, list[str]] = {}
    for task, policy in jobs():
        for name, (kernel, names, values) in exports(task, policy).items():
            if name not in orders:
                text, orders[name] = code_of(kernel, names, values, name)
                (folder / f"{name}.o").write_bytes(object_of(text, name))
    module = linked(folder, list(orders))
    numba: Any = importlib.import_module("numba")
    for place in (wayfield.__file__, numba.__file__, __file__):  # whose files Numba names in errors, by the whole path
        home = str(Path(place).parent).encode()
        module = module.replace(home, b"/" * len(home))
    return module, orders


def linked(folder: Path, names: Sequence[str]) -> bytes:
    """Returns the module of the object files in a folder."""
    out = folder / MODULE
    linker = [
        sys.executable,
        "-m",
        "ziglang",
        "wasm-ld",
        "--no-entry",
        "--allow-undefined",
        "--strip-all",
        "--gc-sections",
    ]
    linker += [f"--export=entry_{name}" for name in names] + ["--export=__heap_base", "--export-memory"]
    linker += [
        "-z",
        f"stack-size={STACK}",
        "--initial-memory=16777216",
        *(str(folder / f"{name}.o") for name in names),
        "-o",
        str(out),
    ]
    subprocess.run(linker, check=True)
    return out.read_bytes()


@click.command("wasm", cls=OneLineErrors)
@click.option("--out", type=click.Path(path_type=Path), help="Folder.  [default: beside the page's other files]")
@click.option(
    "--tables", "unchanged", is_flag=True, help="Only the tables: gains, data sheets, agents. Kernels are as they were."
)
def main(out: Path | None, unchanged: bool) -> None:
    """Builds the page's WebAssembly module and its tables from the sources of today."""
    # where an editable install's links lead
    folder = out or (Path(report.__path__[0]) / "page" / TABLES).resolve().parent
    if unchanged:
        content = {"orders": json.loads((folder / TABLES).read_text(encoding="utf-8"))["orders"], **tables()}
        write_whole(folder / TABLES, json.dumps(content, separators=(",", ":"), allow_nan=False).encode())
        return
    try:
        import ziglang  # noqa: F401
    except ModuleNotFoundError:
        raise click.ClickException(f"ziglang is missing: {installs('wasm')}") from None
    with tempfile.TemporaryDirectory() as scratch:
        if "WAYFIELD_WASM" not in os.environ:  # numba's code is asked for, which its cache does not keep
            environment = os.environ | {"WAYFIELD_WASM": "1", "NUMBA_CACHE_DIR": scratch}
            raise SystemExit(subprocess.run([sys.executable, *sys.argv], env=environment).returncode)
        module, orders = built(Path(scratch))
    content = {"orders": orders, **tables()}
    write_whole(folder / MODULE, module)
    write_whole(folder / TABLES, json.dumps(content, separators=(",", ":"), allow_nan=False).encode())
    click.echo(f"{folder / MODULE}: {len(module)} bytes; {TABLES}: {(folder / TABLES).stat().st_size} bytes")


if __name__ == "__main__":
    main()
