"""Levels of instruction sets: what machine code made on one processor needs of another."""

import functools
import platform

from llvmlite import binding

# Of the x86-64 psABI, section 3.1.1, by LLVM's names of the features, highest first.
_X86_64 = {
    "x86-64-v4": ("avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"),
    "x86-64-v3": ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"),
    "x86-64-v2": ("cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3"),
}


@functools.cache
def levels() -> tuple[str, ...]:
    """Returns LLVM's names of the levels that this processor has, highest first; of 64-bit ARM there is one."""
    machine = platform.machine().lower()
    if machine in ("aarch64", "arm64"):
        return ("generic",)
    if machine not in ("x86_64", "amd64"):
        return ()
    there = binding.get_host_cpu_features()
    lacking = [place for place, needs in enumerate(_X86_64.values()) if not all(map(there.get, needs))]
    return tuple(_X86_64)[max(lacking, default=-1) + 1 :]


def features_of(level: str) -> str:
    """Returns what LLVM is told beside the name of a level.

    It would keep AVX-512 to half of its width, as its first processors wanted: scans took 8 % longer on a Zen 4.
    """
    return "-prefer-256-bit" if level == "x86-64-v4" else ""


def settings_of(level: str) -> dict[str, str]:
    """Returns the environment variables of a process that compiles for a level."""
    return {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": features_of(level)}
