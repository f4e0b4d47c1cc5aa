"""The `wayfield` command: what it hands over, what it says without an extra, its lists, films and the game."""

import importlib
import importlib.metadata
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
import types
import warnings
from pathlib import Path
from typing import Any

import click
import numpy as np
import pygame
import pytest
from click.testing import CliRunner
from PIL import Image

import wayfield
from wayfield import command, starting
from wayfield.benchmarks.commands import evaluate, lists, play
from wayfield.benchmarks.commands.robot import robot
from wayfield.benchmarks.figures import video
from wayfield.benchmarks.figures.one_drive import Place
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import GOAL_SCENARIOS, PATH_SCENARIOS, SPLITS, TASKS
from wayfield.policies import ABOUT, POLICIES
from wayfield.system.command_line import Names, OneLineErrors
from wayfield.system.extras import installs

NOT_THERE = """
import builtins, sys
missing = {missing!r}
real = builtins.__import__
def imported(name, *rest, **more):
    if name.partition(".")[0] in missing:
        raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
    return real(name, *rest, **more)
builtins.__import__ = imported
sys.argv = ["wayfield", *{words!r}]
from wayfield.command import main
main()
"""


def said(*words: str, missing: tuple[str, ...] = (), folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Returns what a new process says, as if some packages were not installed."""
    program = NOT_THERE.format(missing=missing, words=words)
    return subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=False)


def test_the_version_is_that_of_the_install_and_needs_nothing_more() -> None:
    told = said("--version", missing=("click", "rich", "numba", "scipy"))
    assert told.stdout == f"wayfield {wayfield.__version__}\n"
    assert wayfield.__version__[0].isdigit()


def test_the_help_names_every_command_without_any_extra() -> None:
    for words in ((), ("--help",)):
        told = said(*words, missing=("click", "rich", "numba"))
        assert told.returncode == 0, told.stderr
        assert all(f"  {name} " in told.stdout for name in command.COMMANDS)


def test_a_reader_who_leaves_gets_no_traceback() -> None:
    left, ours = os.pipe()
    os.close(left)
    told = subprocess.run([sys.executable, "-m", "wayfield.command"], stdout=ours, stderr=subprocess.PIPE, check=False)
    os.close(ours)
    assert (told.returncode, told.stderr) == (1, b"")


@pytest.mark.parametrize("name", ["evaluate", "train", "render"])
def test_without_its_extra_a_command_says_one_line(name: str) -> None:
    told = said(name, "--help", missing=("click",))
    assert told.returncode == 1
    assert told.stderr == f"wayfield {name}: click is missing: {installs(command.COMMANDS[name].extra)}\n"


@pytest.mark.parametrize(
    ("words", "missing"),
    [
        ("play", "pygame"),
        ("render --help", "pygame"),
        ("render --policy zero --seconds 0.1 --out a.gif", "pygame"),
        ("render --policy zero --seconds 0.1 --out a.mp4", "moviepy"),
    ],
)
def test_without_a_package_of_the_extra_games_and_films_say_one_line(words: str, missing: str, tmp_path: Path) -> None:
    told = said(*words.split(), missing=(missing,), folder=tmp_path)
    name = words.split()[0]
    assert told.stderr == f"wayfield {name}: {missing} is missing: {installs('render')}\n"
    assert not list(tmp_path.iterdir())


def test_what_a_policy_of_the_users_own_lacks_is_no_extra_of_ours(tmp_path: Path) -> None:
    lines = (
        "from wayfield.policies.zero import Zero",
        "class Mine(Zero):",
        " def act(self, *given):",
        "  import nowhere",
    )
    (tmp_path / "mine.py").write_text("\n".join(lines))
    words = "render", "--policy", "mine:Mine", "--seconds", "0.1", "--out", "a.gif"
    told = said(*words, folder=tmp_path)
    assert told.returncode == 1
    (line,) = told.stderr.splitlines()
    assert "'nowhere'" in line
    assert "pip install" not in line


def test_an_extra_is_installed_from_where_wayfield_came(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "a clone"
    place.mkdir()
    git = {"url": "https://host/wayfield.git", "vcs_info": {"vcs": "git"}}
    lines = {
        json.dumps({"url": place.as_uri(), "dir_info": {"editable": True}}): f'pip install -e "{place}[train]"',
        json.dumps({"url": place.as_uri(), "dir_info": {}}): f'pip install "{place}[train]"',
        json.dumps(
            {"url": (tmp_path / "gone").as_uri(), "dir_info": {}}
        ): 'pip install ".[train]" in a clone of wayfield',
        json.dumps(git): 'pip install "wayfield[train] @ git+https://host/wayfield.git"',
        None: 'pip install "wayfield[train]"',
        "{": 'pip install "wayfield[train]"',
    }
    for came, line in lines.items():
        found = types.SimpleNamespace(read_text=lambda name, came=came: came)
        monkeypatch.setattr(importlib.metadata, "distributions", lambda found=found, **_: [found])
        assert installs("train") == line


def test_films_and_games_need_no_more_than_their_extra() -> None:
    program = NOT_THERE.format(
        missing=("rich", "matplotlib", "tabulate", "optuna", "torch"), words=("render", "--help")
    )
    both = program.replace("main()", "import wayfield.benchmarks.commands.play\nmain()")  # which the game is
    told = subprocess.run([sys.executable, "-c", both], capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stderr
    assert told.stdout.startswith("Usage: wayfield render ")


def test_a_wrong_name_is_answered_with_the_nearest() -> None:
    assert "'evalute' is no command. Did you mean 'evaluate'? Choose from evaluate, train" in said("evalute").stderr
    assert "comes behind its command: wayfield evaluate --suite" in said("--suite", "documents").stderr


def test_every_command_tells_its_version_and_knows_a_misspelt_one() -> None:
    for word in ("--versoin", "--verison", "version"):
        assert "is no command. Did you mean '--version'? Choose" in said(word).stderr
    assert "is no option. Did you mean '--level'?" in said("compile", "--lvel", "x86-64-v3").stderr
    for name, each in command.COMMANDS.items():
        if name in ("ros", "compile"):  # which are none of click's
            continue
        run = getattr(importlib.import_module(each.module), each.function)
        assert CliRunner().invoke(run, ["--version"]).output == f"wayfield {wayfield.__version__}\n", name
        told = CliRunner().invoke(run, ["--versoin"]).stderr
        assert re.search("No such option '--versoin'.*Did you mean.*'--version'", told), told
        told = CliRunner().invoke(run, ["-version"]).stderr
        assert "'-version' is no option. Did you mean '--version'?" in told, told
    for word in ("\u2013suite", "\u2014suite"):  # as a page's typesetter leaves two hyphens
        told = CliRunner().invoke(evaluate.main, [word, "docking"]).stderr
        assert f"{word!r} is no option. Did you mean '--suite'?" in told


def test_the_lists_name_all_that_there_is_and_fit_80_columns() -> None:
    for what, source in ((each.what, each.source) for each in ABOUT.values()):
        assert source == "" or re.search(r"(19|20)\d\d| (report|paper)$|Nav2|Rajamani", source), source
        assert not re.search(r"(19|20)\d\d", what), what
    families = [family for spec in TASKS.values() for family in spec.families]
    # below each stands what its columns mean, and what else may be named
    below = {
        lists.policies: ["Inputs:", "Needs:", "wayfield.policies.make(NAME)"],
        lists.scenarios: [*(f"{name} ({count})" for name, count in SPLITS.items()), *PATH_SCENARIOS, *GOAL_SCENARIOS],
        lists.robots: ["Hull:", "At most:"],
    }
    for listed, names in ((lists.policies, POLICIES), (lists.scenarios, families), (lists.robots, ROBOTS)):
        for width in (80, 100, 1000):
            shown = CliRunner(env={"COLUMNS": str(width)}).invoke(listed, [])
            assert shown.exit_code == 0, shown.output
            lines = shown.output.splitlines()
            firsts = {line.split()[0] for line in lines if line.strip()}
            assert set(names) <= firsts
            assert max(map(len, lines)) <= width
            told = " ".join(shown.output.split())
            assert all(each in told for each in below[listed])
        mine, other = names if isinstance(names, list) else list(names), CliRunner().invoke(listed, ["nothing"])
        some = CliRunner().invoke(listed, [mine[1], mine[0]])
        firsts = [line.split()[0] for line in some.output.splitlines() if line.strip()]
        assert [each for each in firsts if each in mine] == mine[:2]
        part = mine[-1][1:4]  # not a name, so all that it is a part of, or the task or drive of
        firsts = [line.split()[0] for line in CliRunner().invoke(listed, [part]).output.splitlines() if line.strip()]
        assert [each for each in firsts if each in mine] == [each for each in mine if part in each]
        assert other.exit_code == 2
        assert "'nothing' is unknown." in str(other.stderr)
    docks = TASKS["docking"]
    of_suite = [CliRunner().invoke(lists.scenarios, [word]).output for word in (docks.suite, docks.kind)]
    assert of_suite[0] == of_suite[1]
    assert all(f" {family} " in of_suite[0] for family in docks.families)


PATH = ("DiffDrivePathFollowing-v0", "--scenario", "s_curve", "--policy", "pure_pursuit", "--seconds", "1")


@pytest.mark.parametrize(
    ("scenario", "kind"), [(None, "path"), ("rooms", "goal"), ("berth/test", "dock"), ("splines", "path"),
                           ('{"goal": [1, 0, 0]}', "goal"), ('{"dock": [1, 0, 0]}', "dock")]
)  # fmt: skip
def test_a_policy_of_many_tasks_drives_that_of_the_scenario(scenario: str | None, kind: str, tmp_path: Path) -> None:
    if scenario and scenario[0] == "{":
        (tmp_path / "mine.json").write_text(scenario)
        scenario = str(tmp_path / "mine.json")
    place = Place(None, scenario, None, None, "lagged", None, None, (), 0, "default")
    assert place.make("zero").unwrapped.task.spec.kind == kind


@pytest.mark.parametrize("suffix", [".png", ".gif", ".mp4"])
def test_a_policy_is_filmed(suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"film{suffix}"
    shown = CliRunner().invoke(
        video.main, [*PATH, "--ghost", "stanley", "--ghost", "lqr", "--size", "300", "--out", str(file)]
    )
    assert shown.exit_code == 0, shown.output
    told = "; ".join(f"{name}: under way for 1.00 s" for name in ("pure_pursuit", "stanley", "lqr"))
    assert f"{told}; written to" in shown.output
    if suffix == ".mp4":
        from moviepy import VideoFileClip

        with VideoFileClip(str(file)) as clip:
            assert clip.duration == pytest.approx(2.0, abs=0.2)  # the last moment is shown for a second
    elif suffix == ".gif":
        with Image.open(file) as film:
            assert film.n_frames > 5  # type: ignore[attr-defined]
    assert file.stat().st_size > 1000
    again = CliRunner().invoke(video.main, [*PATH, "--out", str(file)])
    assert "is there already; --force replaces it" in again.stderr


def test_a_film_may_last_longer_than_a_contest_does(tmp_path: Path) -> None:
    words = ["DiffDrivePathFollowing-v0", "--policy", "zero", "--seconds", "61", "--out", str(tmp_path / "way.png")]
    assert "zero: the clock ran out after 61.00 s" in CliRunner().invoke(video.main, words).output


def test_a_gif_shows_the_frames_it_is_given_each_for_its_time() -> None:
    frames = [np.full((40, 60, 3), 255, np.uint8) for _ in range(6)]
    for k, frame in enumerate(frames[:4]):  # the last two are alike
        frame[5 * k : 5 * k + 9, 7 * k : 7 * k + 5] = (0, 114, 178) if k % 2 else (213, 94, 0)
    frames[0][-1, :2] = (0, 114, 178), (213, 94, 0)  # colours are those of the first
    with Image.open(io.BytesIO(b"".join(video.gif(iter(frames), 0.033)))) as film:
        shown, times = [], []
        for k in range(film.n_frames):  # type: ignore[attr-defined]
            film.seek(k)
            shown.append(np.asarray(film.convert("RGB")).astype(int))
            times.append(film.info["duration"])
    assert len(shown) == 5
    assert sum(times) == pytest.approx(6 * 33, abs=10)
    for mine, theirs in zip(shown, frames, strict=False):
        np.testing.assert_allclose(mine, theirs, atol=3)


def test_a_film_of_many_steps_takes_little_more_memory_than_one_of_few(tmp_path: Path) -> None:
    """In a process of its own: frames of 60 steps more alone would be 70 MB."""
    program = """
import resource, sys
from click.testing import CliRunner
from wayfield.benchmarks.figures import video
most = []
for seconds in ("1", "4"):
    for suffix in ("gif", "mp4"):
        words = ["DiffDrivePathFollowing-v0", "--policy", "zero", "--seconds", seconds, "--force"]
        assert CliRunner().invoke(video.main, [*words, "--out", f"{sys.argv[1]}.{suffix}"]).exit_code == 0
    most.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
print(most[1] - most[0])
"""
    command = [sys.executable, "-c", program, str(tmp_path / "film")]
    assert float(subprocess.run(command, capture_output=True, text=True, check=True).stdout) < 50.0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--policy", "pure_persuit", "--out", "a.png"], "Did you mean 'pure_pursuit'?"),
        (["--policy", "pure_pursuit", "--out", "a.avi"], "must end in .mp4, .gif, .png"),
        (["DiffDriveGoalObstacles-v0", "--policy", "stanley", "--out", "a.png"], "Stanley reads"),
        (["--policy", "lqr", "--set", "render_mode=human", "--out", "a.png"], "--set render_mode is not needed"),
        (["--policy", "stanley", "--scenario", "s_curve", "--index", "7", "--out", "a.png"], "from 0 to 0"),
        (["--policy", "waypoint", "--robot", "p3dx", "--out", "a.png"], "goes sideways"),
    ],
)
def test_wrong_words_are_one_line(
    words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shown = CliRunner().invoke(video.main, words)
    assert shown.exit_code == 2, shown.output
    assert message in shown.stderr
    assert shown.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("option", ["--mjcf", "--picture"])
def test_a_model_is_not_written_over_what_is_none(option: str, tmp_path: Path) -> None:
    (tmp_path / "mine.json").write_text("{}")
    shown = CliRunner().invoke(robot, ["p3dx", option, str(tmp_path / "mine.json")])
    assert shown.exit_code == 2
    assert "must end in ." in shown.stderr
    assert (tmp_path / "mine.json").read_text() == "{}"


# The game.


def place(env_id: str, **other: Any) -> Place:
    """Returns an easy place."""
    nothing = dict.fromkeys(("scenario", "index", "robot", "dynamics", "disturbance"))
    return Place(
        **{"env_id": env_id, **nothing, "actuators": "ideal", "settings": (), "seed": 0, "gains": "tuned"} | other
    )


def press(key: int, up: bool = False) -> pygame.event.Event:
    return pygame.event.Event(pygame.KEYUP if up else pygame.KEYDOWN, key=key)


def moved(game: play.Game, keys: list[int], steps: int = 10) -> np.ndarray[Any, Any]:
    """Returns how far the robot goes in its own frame (ahead, left, turned) while keys are held."""
    game.begin()
    x, y, heading = game.mine.pose
    for key in keys:
        game.hear(press(key))
    for _ in range(steps):
        game.step()
    for key in keys:
        game.hear(press(key, up=True))
    to_x, to_y, to_heading = game.mine.pose
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.array(
        [cosine * (to_x - x) + sine * (to_y - y), cosine * (to_y - y) - sine * (to_x - x), to_heading - heading]
    )


def test_keys_drive_where_they_say() -> None:
    """Half a second at 0.6 m/s and 1.5 rad/s, without lag."""
    game = play.Game(place("OmniPathFollowing-v0"), (), 0.6, 1.5)
    for keys, way in (
        ([pygame.K_UP], (0.3, 0.0, 0.0)),
        ([pygame.K_s], (-0.3, 0.0, 0.0)),
        ([pygame.K_a], (0.0, 0.3, 0.0)),
        ([pygame.K_d], (0.0, -0.3, 0.0)),
        ([pygame.K_LEFT], (0.0, 0.0, 0.75)),
        ([pygame.K_w, pygame.K_UP], (0.3, 0.0, 0.0)),
        ([pygame.K_w, pygame.K_s], (0.0, 0.0, 0.0)),
        ([pygame.K_w, pygame.K_d], (0.3 / 2**0.5, -0.3 / 2**0.5, 0.0)),
    ):
        np.testing.assert_allclose(moved(game, keys), way, atol=1e-6)
    game = play.Game(place("DiffDrivePathFollowing-v0"), (), 0.6, 1.5)
    np.testing.assert_allclose(moved(game, [pygame.K_a]), (0.0, 0.0, 0.75), atol=1e-6)
    np.testing.assert_allclose(moved(game, [pygame.K_RIGHT]), (0.0, 0.0, -0.75), atol=1e-6)
    game.close()


def test_the_ghost_meets_what_the_player_meets() -> None:
    game = play.Game(place("DiffDrivePathFollowing-v0", disturbance="moderate"), ("pure_pursuit",), 0.6, 1.5)
    (beside,) = game.ghosts
    for _ in range(2):
        assert game.mine.single.batch.states.tobytes() == beside.single.batch.states.tobytes()
        for _ in range(3):
            game.step()  # before the first key nothing moves
        assert game.mine.steps == beside.steps == 0
        game.hear(press(pygame.K_UP))
        for _ in range(20):
            game.step()
        assert game.mine.steps == beside.steps == 20
        (ghost,) = game.scene().ghosts
        assert ghost.pose == beside.pose != game.mine.pose
        game.hear(press(pygame.K_n))
    game.close()


def test_an_episode_ends_and_is_told_and_begins_again() -> None:
    game = play.Game(place("DiffDrivePathFollowing-v0", scenario="s_curve"), (), 1.2, 3.0)
    game.hear(press(pygame.K_DOWN))
    told = [line for line in (game.step() for _ in range(200)) if line]
    assert len(told) == 1
    assert told[0].startswith("seed 0: you: left corridor after")
    assert "R again" in game.scene().caption
    game.hear(press(pygame.K_r))
    assert not game.mine.ended
    assert not game.hands.held
    game.hear(press(pygame.K_n))
    assert game.seed == 1
    game.close()


def test_without_a_display_the_game_says_one_line(tmp_path: Path) -> None:
    bare = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    bare = {key: value for key, value in bare.items() if not key.startswith("SDL_")}
    told = subprocess.run(
        [sys.executable, "-m", "wayfield.command", "play"], env=bare, capture_output=True, text=True, cwd=tmp_path
    )
    assert told.returncode == 1
    assert told.stderr.startswith("play: there is no display")
    assert told.stderr.count("\n") == 1


@pytest.mark.parametrize(("number", "raised"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)])
def test_a_signal_that_falls_into_a_destructor_is_not_lost(
    number: int, raised: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    def handler(*_: object) -> None:
        raise raised

    class Late:
        def __del__(self) -> None:
            raise raised

    monkeypatch.setattr(sys, "unraisablehook", starting.again)
    before = signal.signal(number, handler)
    try:
        late = [Late()]
        late.clear()
        with pytest.raises(raised):
            time.sleep(10.0)
    finally:
        signal.signal(number, before)


@pytest.mark.filterwarnings("default::RuntimeWarning")
def test_what_is_said_of_compiled_code_is_a_line() -> None:
    @click.command("evaluate", cls=OneLineErrors)
    def told() -> None:
        warnings.warn("wayfield compiles anew in every process", RuntimeWarning, stacklevel=1)

    assert CliRunner().invoke(told).stderr == "evaluate: wayfield compiles anew in every process\n"


def test_of_an_option_given_twice_the_last_counts_and_a_line_says_so() -> None:
    @click.command("drive", cls=OneLineErrors)
    @click.option("--seed", type=int)
    @click.option("--force", is_flag=True)
    @click.option("--set", "pairs", multiple=True)
    @click.option("--policies", type=Names("--policies", ["lqr", "mpc"]))
    def drive(seed: int, force: bool, pairs: tuple[str, ...], policies: tuple[str, ...]) -> None:
        click.echo((seed, force, pairs, policies))

    ended = CliRunner().invoke(
        drive, ["--seed", "1", "--force", "--set", "a", "--seed", "2", "--set", "b", "--force", "--seed", "3"]
    )
    assert (ended.exit_code, ended.stdout) == (0, "(3, True, ('a', 'b'), None)\n")
    assert ended.stderr == "drive: --seed is given more than once; the last counts\n"
    ended = CliRunner().invoke(drive, ["--policies", "lqr", "--policies", "mpc"])
    assert ended.exit_code == 2
    assert ended.stderr == "drive: --policies is given more than once; several values are one word: a,b\n"
