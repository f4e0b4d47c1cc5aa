"""Driving by the keyboard, key by key, with drives that only pretend; and which run each section of the page is."""

import dataclasses
import math
import types
from typing import Any

import numpy as np
import pytest

from wayfield.benchmarks import own_policies, sections
from wayfield.benchmarks.contests import CONTESTS
from wayfield.envs.robots import ROBOTS
from wayfield.policies.learned.ppo import shipped

pygame = pytest.importorskip("pygame", reason='needs pip install "wayfield[render]"')
from wayfield.benchmarks import play  # noqa: E402  it imports pygame

UP, DOWN, LEFT, RIGHT = pygame.K_UP, pygame.K_DOWN, pygame.K_LEFT, pygame.K_RIGHT


@pytest.mark.parametrize("name", ["p3dx", "omni3"])
def test_keys_that_are_held_are_a_twist(name: str) -> None:
    robot = ROBOTS[name]
    hands = play.Hands((dict,), 0.8, 1.5)
    briefing: Any = types.SimpleNamespace(robot=robot, num_envs=2)
    assert hands.reset(briefing).shape == (2, 0)
    for keys, ahead, aside, left in (
        ((), 0, 0, 0), ((UP,), 1, 0, 0), ((DOWN,), -1, 0, 0), ((UP, DOWN), 0, 0, 0), ((LEFT,), 0, 0, 1),
        ((RIGHT,), 0, 0, -1), ((UP, LEFT), 1, 0, 1), ((UP, pygame.K_w), 1, 0, 0), ((pygame.K_s,), -1, 0, 0),
        ((pygame.K_a,), 0, 1, 0), ((pygame.K_d,), 0, -1, 0), ((pygame.K_w, pygame.K_a), 1, 1, 0),
        ((pygame.K_F9,), 0, 0, 0),
    ):  # fmt: skip
        hands.held.clear()
        hands.held.update(keys)
        if not robot.holonomic and aside:
            aside, left = 0, aside  # it turns instead
        share = 0.8 / max(1.0, math.hypot(ahead, aside))
        wanted = [share * ahead, share * aside, 1.5 * left] if robot.holonomic else [share * ahead, 1.5 * left]
        found = hands.act(None, briefing, np.empty((2, 0)))
        assert found == pytest.approx(np.array([wanted] * 2)), keys


@dataclasses.dataclass(frozen=True)
class Scene:
    caption: str = "caption"
    ghosts: tuple[Any, ...] = ()
    notes: tuple[str, ...] = ()


class Drive:
    def __init__(self, env: Any, policy: Any) -> None:
        self.env, self.policy, self.steps, self.ended, self.told = env, policy, 0, "", ""
        self.begun: list[Any] = []
        task = types.SimpleNamespace(robot=ROBOTS["omni3"], scenarios=range(3))
        self.single = types.SimpleNamespace(task=task)

    def begin(self, *words: Any) -> None:
        self.begun.append(words)
        self.steps, self.ended = 0, ""

    def step(self) -> None:
        self.steps += 1

    def scene(self) -> Scene:
        return Scene()

    def ghost(self) -> str:
        return "its ghost"


class Place:
    seed, index = 7, 2

    def __init__(self) -> None:
        self.asked: list[Any] = []
        self.closed = 0

    def make(self, ghost: Any) -> Any:
        self.asked.append(ghost)
        layout = types.SimpleNamespace(kind=dict)
        unwrapped = types.SimpleNamespace(task=types.SimpleNamespace(layout=layout))

        def close() -> None:
            self.closed += 1

        return types.SimpleNamespace(unwrapped=unwrapped, close=close)

    def policy(self, name: str, env: Any) -> str:
        return f"policy {name}"


def key(kind: int, code: int = 0) -> Any:
    return types.SimpleNamespace(type=kind, key=code)


@pytest.mark.parametrize("ghost", [None, "lqr"])
def test_a_game_is_its_keys(ghost: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(play, "Drive", Drive)
    place: Any = Place()
    game: Any = play.Game(place, ghost, 0.8, 1.5)
    assert place.asked == ([None] if ghost is None else ["lqr", "lqr"])
    assert (game.hands.speed, game.hands.yaw_rate, game.hands.observes) == (0.8, 1.5, (dict,))
    drives = game.drives
    assert drives == [game.mine] + ([] if ghost is None else [game.ghost])
    assert game.mine.policy is game.hands
    assert ghost is None or game.ghost.policy == "policy lqr"
    assert all(each.begun == [(7, 2)] for each in drives)
    # nothing moves before a key is pressed
    assert game.step() == ""
    assert [each.steps for each in drives] == [0] * len(drives)
    assert game.scene().caption == "caption   drive to start the clock"
    assert len(game.scene().notes) == 2
    assert game.scene().ghosts == (() if ghost is None else ("its ghost",))
    game.hear(key(pygame.KEYDOWN, pygame.K_h))
    assert game.scene().notes == ()
    game.hear(key(pygame.KEYDOWN, pygame.K_h))
    game.hear(key(pygame.KEYDOWN, UP))
    game.hear(key(pygame.KEYDOWN, LEFT))
    assert game.hands.held == {UP, LEFT}
    game.hear(key(pygame.KEYUP, LEFT))
    game.hear(key(pygame.KEYUP, pygame.K_F9))
    assert game.hands.held == {UP}
    assert game.step() == ""
    assert [each.steps for each in drives] == [1] * len(drives)
    assert game.scene().caption == "caption   "
    assert game.scene().notes == ()
    game.hear(key(pygame.KEYDOWN, pygame.K_p))
    assert game.scene().caption == "caption   paused"
    game.step()
    assert game.mine.steps == 1
    game.hear(key(pygame.KEYDOWN, pygame.K_p))
    game.hear(key(pygame.WINDOWFOCUSLOST))
    assert game.hands.held == set()
    game.mine.ended, game.mine.told = "goal", "goal after 3 s"
    if ghost is not None:
        game.ghost.told = "lost"
    told = "seed 7: you: goal after 3 s" + ("" if ghost is None else "; lqr: lost")
    assert game.told() == told
    assert game.step() == ""  # it has ended
    assert game.scene().caption == "caption   goal after 3 s: R again, N next"
    assert len(game.scene().notes) == 2
    game.mine.ended = ""
    monkeypatch.setattr(Drive, "step", lambda self: setattr(self, "ended", "goal"))
    assert game.step() == told
    game.hear(key(pygame.KEYDOWN, pygame.K_r))
    assert game.mine.begun == [(7, 2)] * 2
    assert game.waits
    for seed, index in ((8, 0), (9, 1), (10, 2), (11, 0)):
        game.hear(key(pygame.KEYDOWN, UP))
        game.hear(key(pygame.KEYDOWN, pygame.K_n))
        assert all(each.begun[-1] == (seed, index) for each in game.drives)
        assert game.waits
        assert game.hands.held == set()
    game.index = None
    game.next()
    assert game.mine.begun[-1] == (12, None)
    game.hear(key(pygame.MOUSEMOTION, UP))
    assert game.waits
    assert not game.over
    for last in (key(pygame.QUIT), key(pygame.KEYDOWN, pygame.K_ESCAPE)):
        game.over = False
        game.hear(last)
        assert game.over
    game.close()
    assert place.closed == len(drives)


def test_a_game_is_played_until_it_is_over(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    done: list[Any] = []
    told = iter(["", "you: goal", ""])

    class Game:
        over = False

        def scene(self) -> str:
            return "scene"

        def hear(self, event: str) -> None:
            done.append(event)
            self.over = event == "last"

        def step(self) -> str:
            done.append("step")
            return next(told)

    frames = iter([["a", "b"], [], ["last"]])
    monkeypatch.setattr(play.pygame.event, "get", lambda: next(frames))
    renderer: Any = types.SimpleNamespace(draw=lambda scene: done.append(scene))
    play.run(Game(), renderer)  # type: ignore[arg-type]
    assert done == ["scene", "a", "b", "step", "scene", "step", "scene", "last", "step"]
    assert capsys.readouterr().out == "you: goal\n"


def test_the_algorithm_of_a_model_is_told_by_its_policy() -> None:
    def told(module: Any, **more: Any) -> str:
        return own_policies._algorithm({"policy_class": {"__module__": module}} | more)

    assert told("stable_baselines3.common.policies", clip_range=0.2) == "PPO"
    assert told("stable_baselines3.common.policies") == "A2C"
    assert told("stable_baselines3.sac.policies") == "SAC"
    assert told("stable_baselines3.her.policies") == ""
    assert told("somewhere.sac.policies") == ""
    assert told(None) == ""
    for data in (None, [], "x", {}, {"policy_class": None}, {"policy_class": "stable_baselines3.sac.policies"}):
        assert own_policies._algorithm(data) == ""


def test_every_section_of_the_page_is_one_run() -> None:
    by_name = {section.name: section for section in sections.SECTIONS}
    assert len(by_name) == len(sections.SECTIONS)
    for section in sections.SECTIONS:
        words = section.command.split()
        assert words[0] == "python"
        assert section.tables
        suite = words[words.index("--suite") + 1] if "--suite" in words else ""
        assert section.of_contest == (suite in CONTESTS or section.ladder)
        assert section.ladder == (suite == "disturbances")
        for name in section.tables:
            kept = section.place(name)
            assert kept == (
                f"docs/results/{section.name}.md" if name == "table.md" else f"docs/results/{section.within}{name}"
            )
        for name, words_of_it in section.pictures.items():
            assert section.place(name) == f"docs/{name}"
            assert words_of_it
        if suite in CONTESTS:
            robot = words[words.index("--robot") + 1] if "--robot" in words else "p3dx"
            stem = f"{CONTESTS[suite].stem}_{robot}"
            assert all(name.startswith(stem) for name in section.tables)
            assert section.name.startswith(suite)
            claims = "--split" in words
            assert (section.name == f"{suite}-claims") is claims
            assert section.within == ("claims/" if claims else "")
            if claims:
                assert words[words.index("--policies") + 1].split(",") == list(CONTESTS[suite].claims)
            else:
                assert section.name == (suite if robot == "p3dx" else f"{suite}-{robot}")
                assert (robot in section.title) is (robot != "p3dx") or suite == "goal-obstacles"
    # files that we have not, or hours of training, are asked of nobody
    assert {section.name for section in sections.SECTIONS if section.needs} == {"transfer", "learners"}
    for name, contest in CONTESTS.items():
        for robot in (each for each in ROBOTS if shipped(contest.spec.name, each)):
            assert (name if robot == "p3dx" else f"{name}-{robot}") in by_name
        assert (f"{name}-claims" in by_name) is bool(contest.claims)
