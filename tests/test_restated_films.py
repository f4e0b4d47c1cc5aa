"""What a film shows, frame by frame, stated once more."""

import dataclasses
import io
import itertools
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from wayfield import policies
from wayfield.benchmarks import publish, video
from wayfield.benchmarks.drives import Drive, Place, chased
from wayfield.benchmarks.video import filmed, write_film
from wayfield.envs.robots import ROBOTS
from wayfield.policies.pilot import Pilot

PATH = "wayfield/DiffDrivePathFollowing-v0"
PLACE = Place(PATH, "s_curve", None, None, "lagged", None, None, (), 3, "tuned")


def drive_of(policy: str) -> Drive:
    env = PLACE.make(policy)
    drive = Drive(env, PLACE.policy(policy, env))
    drive.begin(PLACE.seed, PLACE.index)
    return drive


def poses_of(policy: str, steps: int) -> list[tuple[float, float, float]]:
    """Returns the poses of an episode that is driven by hand."""
    env = gymnasium.make(PATH, scenario="s_curve", actuators="lagged")
    single: Any = env.unwrapped
    pilot = Pilot(PLACE.policy(policy, env), env)
    seen, _ = env.reset(seed=3)
    pilot.reset()
    found = []
    for _ in range(steps + 1):
        state = single.batch.states[0]
        found.append((float(state["x"]), float(state["y"]), float(state["heading"])))
        seen, *_ = env.step(pilot.act(seen))
    return found


@pytest.fixture
def frames(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Returns the list of all scenes that are drawn, each as a plane of a grey of its own."""
    drawn: list[Any] = []

    def frame(scene: Any, renderer: Any) -> Any:
        drawn.append(scene)
        return np.full((6, 8, 3), 9 * len(drawn) % 250, np.uint8)

    monkeypatch.setattr(video, "_frame", frame)
    return drawn


def test_a_film_and_its_pictures(frames: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clips: list[tuple[int, float]] = []

    class Clip:
        """Notes how many pictures are shown, and how many a second."""

        def __init__(self, pictures: Any, fps: float) -> None:
            clips.append((len(pictures), fps))

        def write_videofile(self, file: str, **how: Any) -> None:
            assert how["codec"] == "libx264"
            assert how["audio"] is False
            Path(file).write_bytes(b"mp4")

    moviepy = pytest.importorskip("moviepy", reason='needs pip install "wayfield[render]"')
    monkeypatch.setattr(moviepy, "ImageSequenceClip", Clip)
    drive, ghost = drive_of("lookahead_retuned"), drive_of("stanley")
    film = filmed(drive, ghost, 3.0)
    assert (len(film), film.dt) == (61, 0.05)
    assert film.told == "under way for 3.00 s"
    assert list(film.poses) == poses_of("lookahead_retuned", 60)
    assert [scene.ghosts[0].pose for scene in film.scenes] == poses_of("stanley", 60)
    marks = chased(drive.pilot, drive.single)
    x, y, heading = film.poses[-1]
    ahead = drive.pilot.policy.lookahead_distance  # type: ignore[attr-defined]
    assert marks["lookahead"] == pytest.approx((x + ahead * np.cos(heading), y + ahead * np.sin(heading)))

    write_film(film, tmp_path / "way.png", 300, 1.0)
    (scene,) = frames
    # the robot each second before, and the other one where it ended
    assert [each.pose for each in scene.ghosts] == [*film.poses[:60:20], film.scenes[-1].ghosts[0].pose]
    assert Image.open(tmp_path / "way.png").size == (8, 6)

    for pace, skip in ((1.0, 1), (2.4, 2), (0.5, 1)):
        frames.clear()
        write_film(film, tmp_path / "film.gif", 300, pace)
        wait = round(1.0 / (0.05 * skip))
        shown = [*film.scenes[:-1:skip], *itertools.repeat(film.scenes[-1], wait)]
        assert len(frames) == len(shown)
        assert all(one is other for one, other in zip(frames, shown, strict=True))
        gif = Image.open(io.BytesIO((tmp_path / "film.gif").read_bytes()))
        total = 0
        for k in range(gif.n_frames):
            gif.seek(k)
            total += gif.info["duration"]
        # the format counts in hundredths of a second
        assert total == pytest.approx(len(shown) * round(1000.0 * 0.05 * skip / pace), abs=10 * len(shown) // 2)
        assert gif.info["loop"] == 0
        write_film(film, tmp_path / "film.mp4", 300, pace)
        assert (tmp_path / "film.mp4").read_bytes() == b"mp4"
        pictures, a_second = clips.pop()
        assert pictures == len(shown)
        # a second of it shows as many of the robot's as were asked for
        assert 0.05 * skip * a_second == pytest.approx(pace)


def test_a_long_way_is_shown_by_forty_robots(frames: list[Any]) -> None:
    drive = drive_of("pure_pursuit")
    film = filmed(drive, None, 1e4)
    assert drive.ended in ("success", "the clock ran out")
    assert film.told.startswith(drive.ended)
    assert len(film) == drive.steps + 1
    video.picture(film, 300)
    every = max(20, len(film) // 40)
    assert [each.pose for each in frames[0].ghosts] == list(film.poses[:-1:every])
    # and where the frame moved with the robot, by one that holds them all
    assert frames[0].bounds == film.scenes[0].bounds
    moved = ((0.0, 1.0, 2.0, 3.0), (1.0, -1.0, 5.0, 2.0), (0.5, 0.5, 4.0, 2.5))
    scenes = [dataclasses.replace(scene, bounds=bounds) for scene, bounds in zip(film.scenes, moved, strict=False)]
    video.picture(dataclasses.replace(film, scenes=tuple(scenes), poses=film.poses[:3]), 300)
    assert frames[1].bounds == (0.0, -1.0, 5.0, 3.0)
    # of a way that takes minutes not one a second
    poses = tuple((0.01 * k, 0.0, 0.0) for k in range(4001))
    video.picture(dataclasses.replace(film, scenes=film.scenes[:1] * len(poses), poses=poses), 300)
    assert [each.pose for each in frames[2].ghosts] == list(poses[:-1:100])


def test_a_place_is_made_of_all_that_was_asked_for_and_of_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    monkeypatch.setattr(gymnasium, "make", lambda env_id, **told: made.append((env_id, told)))
    every = ("noise=0.5", "num_beams=9", "perfect_pose=false")
    robot = ROBOTS["turtlebot3"]
    Place("DiffDriveGoalObstacles-v0", "rooms/test", 3, robot, "slow", "pymunk", "severe", every, 7, "tuned").make(None)
    Place("wayfield/OmniGoalObstacles-v0", None, None, None, "ideal", None, None, (), 0, "default").make(None)
    of_contest = {"render_mode": "rgb_array", "num_beams": 72, "max_range": 5.0}
    asked = {"scenario": "rooms/test", "robot": robot, "actuators": "slow", "dynamics": "pymunk"}
    asked |= {"disturbance": "severe", "noise": 0.5, "num_beams": 9, "perfect_pose": False}
    assert made == [
        ("wayfield/DiffDriveGoalObstacles-v0", of_contest | asked),
        ("wayfield/OmniGoalObstacles-v0", of_contest | {"actuators": "ideal"}),
    ]


def test_gains_that_are_given_by_hand_come_before_tuned_ones_and_those_before_the_file_s() -> None:
    env = PLACE.make("stanley")
    given = "stanley speed=0.3"
    tuned, default = policies.tuned_gains("stanley", "path-following"), policies.make("stanley")
    there = vars(PLACE.policy(given, env))
    assert there["speed"] == 0.3 != tuned["speed"]
    others = {name: value for name, value in tuned.items() if name != "speed"}
    assert {name: there[name] for name in others} == others
    assert any(value != getattr(default, name) for name, value in others.items())
    for place, seen in ((dataclasses.replace(PLACE, gains="default"), env), (PLACE, None)):
        assert place.policy(given, seen) == dataclasses.replace(default, speed=0.3)  # type: ignore[type-var]


def test_a_film_of_no_time_has_a_step(frames: list[Any]) -> None:
    assert len(filmed(drive_of("zero"), None, 1e-3)) == 2
    assert frames == []


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["film.gif"], (640, 1.0, 3600.0)),
        (["film.png"], (1000, 1.0, 3600.0)),
        (["film.png", "--size", "300", "--pace", "2.5", "--seconds", "0.5"], (300, 2.5, 0.5)),
    ],
)
def test_what_is_asked_for_is_filmed(
    words: list[str], wanted: tuple[int, float, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    film = filmed(drive_of("zero"), None, 0.05)

    def noted(drive: Drive, ghost: Drive | None, seconds: float) -> Any:
        asked.append((type(drive.pilot.policy).__name__, ghost and type(ghost.pilot.policy).__name__, seconds))
        return film

    monkeypatch.setattr(video, "filmed", noted)
    monkeypatch.setattr(video, "write_film", lambda *given: asked.append(given))
    name, *more = words
    place = ["DiffDrivePathFollowing-v0", "--scenario", "s_curve", "--policy", "pure_pursuit", "--ghost", "stanley"]
    done = CliRunner().invoke(video.main, [*place, "--out", str(tmp_path / name), *more])
    assert done.exit_code == 0, done.output
    size, pace, seconds = wanted
    assert asked == [("PurePursuit", "Stanley", seconds), (film, tmp_path / name, size, pace)]
    alone = CliRunner().invoke(video.main, [*place[:-2], "--out", str(tmp_path / name)])
    assert alone.exit_code == 0, alone.output
    assert asked[2][1] is None
    assert "stanley" not in alone.output


@pytest.mark.parametrize(("steps", "shown"), [(1, 2), (8, 3), (10, 4), (10_000, 110)])
def test_the_film_of_the_first_page_goes_at_twice_the_pace_to_the_end_or_for_as_long_as_it_may(
    steps: int, shown: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Drawn:
        """An environment whose steps take 0.05 s and whose frames tell the step that they are of."""

        taken, closed = 0, False

        def reset(self, **how: Any) -> Any:
            assert how == {"seed": 0, "options": {"scenario": 0}}
            return "seen", {}

        def step(self, action: Any) -> Any:
            self.taken += 1
            return "seen", 0.0, self.taken == steps, False, {}

        def render(self) -> Any:
            return np.full((30, 60, 3), self.taken % 200, np.uint8)

        def close(self) -> None:
            self.closed = True

    env, film = Drawn(), video.gif
    frames: list[Any] = []
    monkeypatch.setattr(gymnasium, "make", lambda *_, **__: env)
    pilot = type("Still", (), {"reset": lambda _: None, "act": lambda _, seen: [seen]})
    monkeypatch.setattr("wayfield.policies.Pilot", lambda policy, driven: pilot())
    monkeypatch.setattr(video, "gif", lambda drawn, period: frames.extend(drawn) or film(drawn, period))
    with Image.open(io.BytesIO(publish.moving_picture())) as made:
        # frames that are alike are one in the file; 100 ms each, of 4 steps of 50 ms
        assert sum(made.seek(k) or made.info["duration"] for k in range(made.n_frames)) == 100 * shown
    assert [frame.size for frame in frames] == [(400, 200)] * shown
    # every fourth step, and the last
    times = [4 * k for k in range(shown)]
    assert [frame.getpixel((0, 0))[0] for frame in frames] == [min(each, steps) % 200 for each in times]
    assert env.closed
