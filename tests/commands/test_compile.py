"""Machine code that is made before it is needed: by the level of the processor, and carried by the package."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

import wayfield
from wayfield.benchmarks.commands.compile import compile
from wayfield.system.processor_level import features_of, levels, settings_of

pytestmark = pytest.mark.skipif(not levels(), reason="a processor of no level")
LEVELS = sorted({*levels()[:1], *levels()[-1:]}, key=levels().index)  # this processor's, and the lowest

SINES = """
import sys, wayfield.system.elementary as e
values = [e.sin_cos(0.1 * k) for k in range(100)]
print(hash(tuple(values)), sum(e.sin_cos.stats.cache_hits.values()), sum(e.sin_cos.stats.cache_misses.values()))
"""


class Copy:
    """A copy of the package, without its rooms of commands, whose `machine_code` can be filled."""

    def __init__(self, home: Path) -> None:
        self.home = home
        self.carried = home / "wayfield" / "machine_code"
        without = {"__pycache__", "benchmarks", "agents", "gains", "machine_code"}
        shutil.copytree(Path(wayfield.__file__).parent, home / "wayfield", ignore=lambda folder, names: without)

    def run(self, cache: Path, code: str = SINES, **settings: str) -> "subprocess.CompletedProcess[str]":
        """Runs code with that copy, and a folder for what it compiles; what may not be written, not by root either."""
        environment = os.environ | settings | {"PYTHONPATH": str(self.home), "NUMBA_CACHE_DIR": str(cache)}
        bound = ["setpriv", "--bounding-set", "-dac_override", "--inh-caps", "-all"]
        words = [*(bound if shutil.which("setpriv") and os.geteuid() == 0 else []), sys.executable, "-c", code]
        return subprocess.run(words, env=environment, cwd=self.home, capture_output=True, text=True, check=True)


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    return Copy(tmp_path / "copy")


def test_what_the_package_carries_is_compiled_by_nobody_and_has_the_same_bits_at_each_level(
    copy: Copy, tmp_path: Path
) -> None:
    bits = set()
    for level in LEVELS:
        made, hits, misses = copy.run(copy.carried, **settings_of(level)).stdout.split()
        assert (hits, misses) == ("0", "1")
        bits.add(made)
    cache = tmp_path / "empty"
    for settings in ({}, settings_of(LEVELS[-1])):  # without settings it is this processor's level
        found = copy.run(cache, **settings)
        made, hits, misses = found.stdout.split()
        assert (hits, misses, found.stderr) == ("1", "0", "")
        bits.add(made)
    assert len(bits) == 1
    assert not list(cache.rglob("*.nb?"))


@pytest.mark.skipif(not shutil.which("setpriv"), reason="needs setpriv, of util-linux")
def test_a_shared_folder_that_may_only_be_read_serves_its_code(copy: Copy, tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    bits = copy.run(shared).stdout.split()[0]
    folders = [shared, *(each for each in shared.iterdir() if each.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    assert copy.run(shared).stdout.split() == [bits, "1", "0"]
    for folder in folders:
        folder.chmod(0o755)


@pytest.mark.slow
def test_code_of_a_lower_level_is_run_where_the_package_carries_no_other(copy: Copy, tmp_path: Path) -> None:
    copy.run(copy.carried, **settings_of(levels()[-1]))
    assert copy.run(tmp_path / "empty").stdout.split()[1:] == ["1", "0"]
    if len(levels()) > 1:  # and code of a higher one never
        shutil.rmtree(copy.carried)
        copy.run(copy.carried)
        assert copy.run(tmp_path / "empty", **settings_of(levels()[-1])).stdout.split()[1:] == ["0", "1"]


@pytest.mark.slow
def test_machine_code_that_is_damaged_foreign_or_of_another_version_is_not_run(copy: Copy, tmp_path: Path) -> None:
    bits = copy.run(copy.carried).stdout.split()[0]
    (code,) = copy.carried.rglob("*.nbc")
    (index,) = copy.carried.rglob("*.nbi")
    whole = code.read_bytes(), index.read_bytes()
    flipped = bytearray(whole[0])
    flipped[len(flipped) // 2] ^= 1  # within the machine code: nothing that reads it would notice
    cases = [
        (bytes(flipped), whole[1], 1),
        (whole[0], whole[1][:100], 1),
        (whole[0], whole[1].replace(numba.__version__.encode(), b"0.60.0"), 0),
    ]
    for place, (code_now, index_now, warned) in enumerate(cases):
        code.write_bytes(code_now)
        index.write_bytes(index_now)
        found = copy.run(tmp_path / str(place))
        assert found.stdout.split() == [bits, "0", "1"]
        assert found.stderr.count("wayfield is damaged") == warned
        assert (code.read_bytes(), index.read_bytes()) == (code_now, index_now)  # the package is not written to
    assert copy.run(tmp_path / "0").stdout.split() == [bits, "1", "0"]  # kept where the user keeps it


SUMS = """
import numba.core.registry, numpy as np
from wayfield.system.compiled import compiled

@compiled
def fused(x, y, z, out):
    for k in range(len(x)):
        out[k] = x[k] * y[k] + z[k]

x, y, z = np.random.default_rng(0).normal(size=(3, 1000))
out = np.empty(1000)
fused(x, y, z, out)
print((out == x * y + z).all(), numba.core.registry.cpu_target.target_context.codegen().magic_tuple()[1:])
"""


def test_a_product_and_a_sum_are_rounded_each_at_every_level_and_the_users_choice_of_processor_holds(
    tmp_path: Path,
) -> None:
    (tmp_path / "sums.py").write_text(SUMS)
    for settings, told in (
        ({}, f"('{levels()[0]}', '{features_of(levels()[0])}')"),
        (settings_of(LEVELS[-1]), f"('{LEVELS[-1]}', '')"),
    ):
        environment = os.environ | settings | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        words = [sys.executable, str(tmp_path / "sums.py")]
        found = subprocess.run(words, env=environment, capture_output=True, text=True, check=True).stdout
        assert found == f"True {told}\n"


def test_numba_that_has_compiled_before_keeps_its_own_processor(tmp_path: Path) -> None:
    before = (
        "import numba\nassert numba.njit(lambda x: x + 1)(1) == 2\nfrom wayfield.system.elementary import sin_cos\n"
    )
    code = before + "print(sin_cos(0.0))"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    words = [sys.executable, "-c", code]
    found = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    assert found.stdout == "(0.0, 1.0)\n"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--level", "x86-64-v9"], "wayfield compile: --level='x86-64-v9' is unknown"),
        (["--only", "dwaa"], "Did you mean 'dwa'"),
        (["--into", "{file}/folder"], "--into"),
        (["--nothing"], "'--nothing' is no option"),
    ],
)
def test_wrong_words_are_refused_in_a_line(
    words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(SystemExit) as ended:
        compile([word.format(file=tmp_path / "file") for word in words], "wayfield compile")
    assert ended.value.code in (1, 2)
    told = capsys.readouterr().err
    assert says in told
    assert told.count("\n") == 1


DRIVE = """
import gymnasium, wayfield
env = gymnasium.make("wayfield/DiffDrivePathFollowing-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
"""


@pytest.mark.slow
def test_an_environment_whose_kernels_were_compiled_into_a_folder_compiles_none(copy: Copy, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "wayfield.command", "compile", "--only", "path_following"]
    subprocess.run([*command, "--into", str(copy.carried)], check=True, cwd=tmp_path)
    assert not copy.run(tmp_path / "empty", DRIVE).stderr
    assert not (tmp_path / "empty").exists()
    # and as what it is, a folder of kernels
    kept = sorted(copy.carried.rglob("*.nbc"))
    shutil.move(copy.carried, tmp_path / "elsewhere")
    assert not copy.run(tmp_path / "elsewhere", DRIVE).stderr
    assert len(list((tmp_path / "elsewhere").rglob("*.nbc"))) == len(kept)
