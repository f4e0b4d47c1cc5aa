"""The identity of an installation: rows of two machines may be combined where it is the same."""

import functools
import hashlib
import importlib.metadata
import importlib.util
import pathlib
import platform

ROOMS = ("envs", "policies", "benchmarks")
_SHOW_ONLY = ("publish.py", "page.py", "sections.py", "pictures.py", "reproduction.py")
_PACKAGES = ("numpy", "numba", "llvmlite", "scipy")  # what computes


@functools.cache
def source_digest() -> str:
    """Returns a digest of source files and agents, so that parts of another version are not taken for this one's.

    Left out are the modules that show results and make none.
    """
    digest = hashlib.sha256()
    for room in ROOMS:
        spec = importlib.util.find_spec(f"{__name__.split('.')[0]}.{room}")
        assert spec is not None
        assert spec.submodule_search_locations
        for file in sorted(pathlib.Path(next(iter(spec.submodule_search_locations))).rglob("*")):
            shows = file.name in _SHOW_ONLY or file.parent.name in ("report", "page")
            if file.suffix in (".py", ".json", ".safetensors") and not shows:
                digest.update(file.read_bytes())
    return digest.hexdigest()


def identity() -> dict[str, str]:
    """Returns what must be the same on every machine that shares a run: code with agents, Python, what computes."""
    code = {"code and agents": source_digest()[:12], "python": ".".join(platform.python_version_tuple()[:2])}
    return code | {name: importlib.metadata.version(name) for name in _PACKAGES}


def differences(theirs: dict[str, str], ours: dict[str, str]) -> str:
    """Returns in words what is not the same there as here; nothing where all is."""
    other = [name for name, value in ours.items() if theirs.get(name) != value]
    return ", ".join(f"{name} {theirs.get(name, 'none')} there, {ours[name]} here" for name in other)
