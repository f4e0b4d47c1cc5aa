"""Every function that reads a file is registered with a good file, which `tests/faults` damages."""

import ast
import os
from pathlib import Path

import wayfield
from wayfield import benchmarks, bridges, envs, policies, system

OPENING = {
    *("open", "read_text", "read_bytes", "loadtxt", "genfromtxt", "fromfile", "safe_open", "load_file", "imread"),
    "ZipFile",
}
LOADING = {"np", "numpy", "json", "pickle", "torch", "onnx"}  # whose `load` reads a file
# what opens a file for reading outside of a registered reader, and why that is right
ALLOWED = {
    ("bridges/coppelia/__main__.py", "_write_legacy"): "copies the package's own file",
    ("bridges/coppelia/__main__.py", "_place_of"): "looks whose module is in its place, whatever the content",
    ("bridges/ros/command.py", "_mission"): "reads bytes for read_gains",
    ("benchmarks/commands/demo.py", "main"): "opens a browser",
    ("system/extras.py", "installs"): "the packaging tools' own word about this installation",
    ("system/storage.py", "_alive"): "the system's word about a process",
    ("system/objects.py", "read_text"): "called by the readers of tables, scenarios and data sheets",
    ("system/objects.py", "json_object"): "called by the readers of scenarios and data sheets",
    ("envs/scenarios/tables.py", "_read"): "called by the readers of tables",
    ("envs/scenarios/tables.py", "_points"): "parses lines that were read already",
    ("envs/scenarios/splits.py", "_read"): "called by the reader of splits",
    ("envs/scenarios/recordings.py", "_read"): "called by the readers of recordings",
    ("envs/scenarios/recordings.py", "recorded"): "takes a digest of the text, which the readers read",
    **{
        ("envs/scenarios/maps.py", name): "called by the reader of maps"
        for name in ("_ros_fields", "_octile", "_brightness")
    },
    ("envs/scenarios/arrays.py", "stored_array"): "called by the readers of maps and of BARN's paths",
    ("envs/scenarios/splits.py", "_shipped"): "a sample",
    ("benchmarks/tuning/random_scenes.py", "digest"): "of files that were drawn in the same run",
    ("envs/scenarios/freeze.py", "_written"): "a developer's tool on the package's own files",
    ("system/reading.py", "read_bytes"): "called by the readers of agents and training runs",
    ("system/reading.py", "read_object"): "called by the readers of agents and training runs",
    ("system/reading.py", "read_arrays"): "called by the readers of agents and training states",
    ("policies/learned/agent.py", "_shipped"): "a sample",
    **{("benchmarks/report/page.py", name): "files of the package" for name in ("asset", "kernel_part")},
    (
        "policies/training/slices.py",
        "train_far",
    ): "the bytes of a data sheet, which its reader has read and will read there",
    ("policies/parts/tuned.py", "_read"): "reads bytes for read_gains",
    ("policies/parts/tuned.py", "_read_sample"): "reads bytes for read_gains",
    ("system/storage.py", "_holder"): "names the process of a lock's marker, whatever it holds",
    ("benchmarks/runs/shards.py", "_parsed"): "called by the reader of parts",
    ("benchmarks/runs/shards.py", "_packed"): "takes what it has just written",
    ("policies/training/slices.py", "files_of"): "takes a run's files along, whatever their content",
    ("benchmarks/runs/payloads.py", "payload"): "takes files that were read already along, whatever their content",
    ("benchmarks/runs/shards.py", "_key"): "takes the digest of an agent's card that was read",
    ("bridges/identify/recording.py", "_digest"): "takes a digest, whatever the content",
    ("benchmarks/records/run_folder.py", "_publish"): "flushes what it has just written",
    ("benchmarks/records/run_folder.py", "file_digest"): "takes a digest, whatever the content",
    ("system/numba_internals.py", "_load_data"): "machine code, whose SHA-256 is compared before any of it is read",
    ("system/kernel_digest.py", "sources_digest"): "takes the digest of the package's own files",
    ("system/identity.py", "source_digest"): "takes the digest of the package's own files",
    ("system/executors.py", "_unguarded"): "looks for a main guard in the script that runs",
    **{
        ("benchmarks/records/archive.py", name): "called by the readers of trajectories and drives"
        for name in ("__enter__", "__getitem__")
    },
    ("benchmarks/records/results.py", "read_table"): "called by the readers of episodes and decisions",
    ("bridges/coppelia/codec.py", "_request_of_file"): "calls the reader of requests",
    ("envs/scenarios/files.py", "_content"): "called by the readers of scenarios of one's own",
    ("envs/scenarios/files.py", "of_no_scenario"): "called by them, of a file that is none",
    ("benchmarks/figures/video.py", "_mp4"): "takes what the encoder has just written",
}


def _readings(tree: ast.Module) -> set[str]:
    """Returns every function that opens a file for reading outside of a registered reader."""
    found = set()

    def visit(node: ast.AST, name: str, registered: bool) -> None:
        if isinstance(node, ast.FunctionDef):
            marks = {getattr(each.func, "id", "") for each in node.decorator_list if isinstance(each, ast.Call)}
            name, registered = node.name, registered or "reader" in marks
        if isinstance(node, ast.Call) and not registered and _opens(node):
            found.add(name)
        for child in ast.iter_child_nodes(node):
            visit(child, name, registered)

    visit(tree, "", False)
    return found


def _opens(call: ast.Call) -> bool:
    function = call.func
    if isinstance(function, ast.Attribute) and getattr(function.value, "id", "") == "os":
        return False  # handles of folders and devices
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    if name == "load":
        return isinstance(function, ast.Attribute) and getattr(function.value, "id", "") in LOADING
    modes = [each.value for each in call.args[1:2] if isinstance(each, ast.Constant)]
    modes += [each.value.value for each in call.keywords if each.arg == "mode" and isinstance(each.value, ast.Constant)]
    return name in OPENING and not any(str(mode).strip("bt") in ("w", "x", "a") for mode in modes)


def test_every_function_that_reads_a_file_is_registered() -> None:
    found = set()
    for module in (wayfield, system, envs, policies, benchmarks, bridges):
        root = Path(module.__path__[0])
        label = "" if module is wayfield else f"{module.__name__.rpartition('.')[2]}/"
        # parts of an installation may be links, which rglob does not follow
        walked = [Path(here, name) for here, _, names in os.walk(root, followlinks=True) for name in names]
        for file in (each for each in walked if each.suffix == ".py" and (label or each.parent == root)):
            name = label + file.relative_to(root).as_posix()
            if name == "system/readers.py" or name.startswith("benchmarks/studies/"):  # studies are not installed
                continue
            text = file.read_text(encoding="utf-8")
            if any(f"{each}(" in text for each in (*OPENING, "load")):
                found |= {(name, each) for each in _readings(ast.parse(text))}
    assert found - set(ALLOWED) == set(), "give these @reader, so that tests/faults damages their files"
    assert set(ALLOWED) - found == set(), "these open no file any more"
