"""Frames: their shape, where things appear in them, how much is drawn, and the window."""

import dataclasses
import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from wayfield.envs.robots import ROBOTS
from wayfield.envs.tasks.specs import CROWDS, EVERY
from wayfield.envs.world.geometry import OBSTACLE
from wayfield.envs.world.grids import OccupancyGrid
from wayfield.system.extras import installs

pytest.importorskip("pygame")
from wayfield.envs.rendering import Body, Ghost, Mark, Renderer, Scene, person

SCENE = Scene(robot=ROBOTS["p3dx"], pose=(2.0, 2.0, 0.5), bounds=(0.0, 0.0, 10.0, 8.0))


def frame_of(scene: Scene, renderer: Renderer | None = None) -> NDArray[np.uint8]:
    frame = (renderer or Renderer("rgb_array", fps=20)).draw(scene)
    assert frame is not None
    return frame


def changed_centroid(frame: NDArray[np.uint8], background: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Returns the mean (x, y) of the pixels that differ, each weighted by how much."""
    weight = np.abs(frame.astype(np.float64) - background).sum(axis=2)
    rows, columns = np.indices(weight.shape)
    # a pixel's centre lies half a pixel from its corner
    return np.array([(columns * weight).sum(), (rows * weight).sum()]) / weight.sum() + 0.5


def full_scene() -> Scene:
    obstacles = np.zeros(3, OBSTACLE)
    obstacles["cos"] = 1.0
    obstacles["x"], obstacles["y"] = (3.0, 5.0, 7.0), 6.0
    obstacles["radius"][0] = 0.5
    obstacles["half_length"][1:] = 0.8
    obstacles["half_width"][1] = 0.3
    obstacles["mass"][1] = 2.0
    angles = np.linspace(-np.pi, np.pi, 36, endpoint=False)
    return dataclasses.replace(
        SCENE,
        path=np.array([[1.0, 1.0], [9.0, 1.0], [9.0, 7.0]]),
        corridor=0.3,
        obstacles=obstacles,
        goals=np.array([[4.0, 4.0, 0.0], [8.0, 7.0, np.nan]]),
        goal_tolerance=0.2,
        ranges=np.where(angles < 0.0, np.inf, 2.0),
        beam_angles=angles,
        trail=np.array([[1.0, 1.0], [np.nan, np.nan], [2.0, 2.0]]),
        reference=(2.0, 1.0),
        lookahead=(2.4, 2.2),
        start=(1.0, 1.0),
        caption="t = 1.0 s " * 30,
    )


@pytest.mark.parametrize("bounds", [(0, 0, 10, 8), (0, 0, 1, 90), (-50, -1, 50, 1), (3, 3, 3, 3)])
@pytest.mark.parametrize("size_px", [97, 480])
def test_frames_are_even_rgb_arrays(bounds, size_px):
    frame = frame_of(dataclasses.replace(full_scene(), bounds=bounds), Renderer("rgb_array", 20, size_px))
    assert frame.dtype == np.uint8
    assert frame.shape[2] == 3
    assert frame.shape[0] % 2 == frame.shape[1] % 2 == 0
    assert size_px - 1 <= max(frame.shape) <= size_px + 1


def test_frame_size_stays_when_the_world_changes():
    renderer = Renderer("rgb_array", fps=20)
    first = frame_of(SCENE, renderer)
    moved = frame_of(dataclasses.replace(full_scene(), pose=(1e12, np.nan, 0.0)), renderer)
    other_world = frame_of(dataclasses.replace(SCENE, bounds=(0.0, 0.0, 2.0, 30.0)), renderer)
    assert first.shape == moved.shape == other_world.shape


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_robot_moves_as_its_pose_with_y_up(robot):
    renderer = Renderer("rgb_array", fps=20)
    away = frame_of(dataclasses.replace(SCENE, robot=robot, pose=(1e6, 1e6, 0.0)), renderer)
    positions = [(2.0, 2.0), (7.0, 6.5)]
    scenes = [dataclasses.replace(SCENE, robot=robot, pose=(x, y, 0.5)) for x, y in positions]
    seen = [changed_centroid(frame_of(scene, renderer), away) for scene in scenes]
    scale = renderer.view(SCENE).scale
    np.testing.assert_allclose(seen[1] - seen[0], [5.0 * scale, -4.5 * scale], atol=1.5)


def test_a_hull_off_the_axle_is_drawn_where_it_is():
    robot = dataclasses.replace(ROBOTS["husky"], name="off", hull_x=0.05)
    scene = dataclasses.replace(SCENE, robot=robot, bounds=(4.0, 3.0, 6.0, 5.0))
    renderer = Renderer("rgb_array", fps=20)
    away, frame = (frame_of(dataclasses.replace(scene, pose=(x, 4.0, 0.0)), renderer) for x in (1e6, 5.0))
    rows, columns = np.nonzero((frame != away).any(axis=2))
    (x0, y1), (x1, y0) = renderer.view(scene).pixels_from_world(np.array([[4.55, 3.67], [5.55, 4.33]]))
    seen = columns.min(), columns.max() + 1, rows.min(), rows.max() + 1
    np.testing.assert_allclose(seen, (x0, x1, y0, y1), atol=1.5)


def test_of_a_thousand_robots_each_is_shown_where_it_is():
    x, y = np.meshgrid(1.5 * np.arange(40), 1.5 * np.arange(25))
    places = np.column_stack([x.ravel(), y.ravel()])
    crowd = tuple(Body((x, y, 0.3), 0.25, (200, 0, 0)) for x, y in places.tolist())
    scene = dataclasses.replace(SCENE, bounds=(0.0, 0.0, 60.0, 38.0), bodies=crowd)
    whole, chosen = frame_of(scene), list(range(150, 1000, 107))
    without = (frame_of(dataclasses.replace(scene, bodies=crowd[:j] + crowd[j + 1 :])) for j in chosen)
    seen = np.array([changed_centroid(frame, whole) for frame in without])
    # pixels are an affine image of the world
    there = np.column_stack([places[chosen], np.ones(len(chosen))])
    image, *_ = np.linalg.lstsq(there, seen, rcond=None)
    np.testing.assert_allclose(there @ image, seen, atol=0.7)
    assert image[0, 0] == pytest.approx(-image[1, 1], rel=1e-2)


def test_a_small_robot_stays_visible():
    world = dataclasses.replace(SCENE, robot=ROBOTS["omni4"], bounds=(0.0, 0.0, 500.0, 500.0))
    renderer = Renderer("rgb_array", fps=20)
    away = frame_of(dataclasses.replace(world, pose=(1e6, 1e6, 0.0)), renderer)
    frame = frame_of(dataclasses.replace(world, pose=(250.0, 250.0, 0.0)), renderer)
    assert (frame != away).any(axis=2).sum() > 200


def test_obstacles_lie_where_the_world_says():
    renderer = Renderer("rgb_array", fps=20)
    scene = full_scene()
    without = frame_of(dataclasses.replace(SCENE, obstacles=scene.obstacles[:0]), renderer)
    colours = []
    for i in range(3):
        frame = frame_of(dataclasses.replace(SCENE, obstacles=scene.obstacles[i : i + 1]), renderer)
        # the legend gains an entry as well, below the world
        frame[-40:] = without[-40:]
        expected = renderer.view(scene).pixels_from_world((scene.obstacles["x"][i], scene.obstacles["y"][i]))
        np.testing.assert_allclose(changed_centroid(frame, without), expected, atol=1.0)
        colours.append(tuple(frame[round(expected[1]), round(expected[0])]))
    assert colours[0] == colours[2] != colours[1], "what can be pushed has a colour of its own"


def empty_scene(**layers: object) -> Scene:
    """Returns a scene whose robot is far away."""
    return dataclasses.replace(SCENE, **({"pose": (1e6, 1e6, 0.0)} | layers))


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_a_robot_that_turns_is_the_same_picture_turned(robot):
    """By a quarter to the left, in a square around it; by a tenth of that it is already another."""
    reach = 4.0 * robot.hull_radius  # each robot as large in the picture: a pixel's rounding is the same share of it
    world = empty_scene(robot=robot, bounds=(5.0 - reach, 4.0 - reach, 5.0 + reach, 4.0 + reach))
    pictures = []
    for heading in (0.3, 0.3 + 0.05 * np.pi, 0.3 + 0.5 * np.pi):
        renderer = Renderer("rgb_array", fps=20)
        frame = frame_of(dataclasses.replace(world, pose=(5.0, 4.0, heading)), renderer)
        column, row = renderer.view(world).pixels_from_world((5.0, 4.0)).round().astype(int)
        half = int(1.1 * robot.hull_radius * renderer.view(world).scale)
        pictures.append(frame[row - half : row + half, column - half : column + half].astype(int))

    def apart(a: NDArray[np.int64], b: NDArray[np.int64]) -> float:
        return float(np.abs(a - b).mean())

    turned = apart(np.rot90(pictures[0]), pictures[2])
    assert turned < 0.3 * apart(pictures[0], pictures[1])


def other_layers() -> dict[str, object]:
    """Returns another value for each field of a scene."""
    full, room = full_scene(), np.zeros((4, 5), np.bool_)
    moved, room[1, 2] = full.obstacles.copy(), True
    moved["x"] += 0.4
    return {
        "robot": ROBOTS["omni3"], "pose": (2.0, 2.4, 0.5), "bounds": (-1.0, -1.0, 11.0, 8.6),
        "path": full.path[::-1] - 0.3, "corridor": 0.6, "obstacles": moved, "grid": OccupancyGrid(room, 1.0),
        "goals": full.goals + 0.3, "goal_tolerance": 1.5, "ranges": 0.5 * full.ranges, "max_range": 1.2,
        "beam_angles": 0.5 * full.beam_angles, "trail": np.array([[1.0, 1.0], [1.0, 3.0]]), "reference": (2.5, 1.0),
        "lookahead": (2.4, 2.6), "start": (1.5, 1.0), "marks": (Mark(np.array([[4.0, 2.0]]), (9, 9, 9), pixels=6.0),),
        "bodies": (Body((7.0, 5.0, 0.3), 0.3, (9, 9, 9), goal=(3.0, 5.0)), person(4.0, 5.0, 1.0, 0.3)),
        "ghosts": (Ghost(ROBOTS["p3dx"], (6.0, 3.0, 1.0), name="a"),), "name": "you",
        "caption": "t = 2.0 s", "notes": ("a note",),
    }  # fmt: skip


def test_whatever_changes_from_a_frame_to_the_next_is_drawn_as_in_a_first_one():
    layers = other_layers()
    assert layers.keys() == {field.name for field in dataclasses.fields(Scene)}
    first = full_scene()
    room = layers.pop("grid")
    changes = [(first, {name: value}) for name, value in layers.items()]
    for grid in (room, OccupancyGrid(room.occupied.T.copy(), 1.0), None):
        changes.append((dataclasses.replace(first, grid=changes[-1][1].get("grid")), {"grid": grid}))
    used = {size_px: Renderer("rgb_array", 20, size_px) for size_px in (160, 320)}
    for last, change in changes:
        size_px = 320 if change.keys() & {"caption", "name", "notes"} else 160  # small ones have no words
        before = frame_of(last, used[size_px])
        scene = dataclasses.replace(last, **change)
        after = frame_of(scene, used[size_px])
        assert (after != before).any(), change
        np.testing.assert_array_equal(after, frame_of(scene, Renderer("rgb_array", 20, size_px)), err_msg=str(change))


def test_the_first_frame_of_an_episode_shows_nothing_of_the_last():
    env = gymnasium.make("wayfield/DiffDrivePathFollowing-v0", render_mode="rgb_array").unwrapped
    env.reset(seed=1)
    first = env.render()
    for _ in range(30):
        env.step(0.5 * env.action_space.high)
    env.marks = {"lookahead": (0.5, 0.5), "reference": (0.2, 1.0)}
    assert (env.render() != first).any()
    env.reset(seed=1)
    np.testing.assert_array_equal(env.render(), first)


IDS = [env_id for spec in EVERY.values() for env_id in spec.ids.values()]


SIZES = ((640, 640), (101, 64))


@pytest.mark.parametrize(("env_id", "size"), [(env_id, SIZES[(k + k // 2) % 2]) for k, env_id in enumerate(IDS)])
def test_all_frames_of_an_id_have_the_size_that_is_asked_for_in_every_scenario(env_id, size):
    kwargs = {"render_mode": "rgb_array"} | ({} if size == (640, 640) else {"frame_size": size})
    single = gymnasium.make(env_id, **kwargs)
    many = gymnasium.make_vec(env_id, 8, vectorization_mode="vector_entry_point", **kwargs)
    many.reset(seed=0)
    frames = [*many.render()]
    for seed in range(3):
        single.reset(seed=seed)
        frames.append(single.render())
    single.close()
    many.close()
    assert {frame.shape for frame in frames} == {(size[1], size[0], 3)}


@pytest.mark.parametrize("size", [640, (640,), (640, 31), (640.0, 480), (640, 5000), "ab", None, (True, 640)])
def test_a_wrong_frame_size_is_one_line_that_names_it(size):
    with pytest.raises(ValueError, match=r"^frame_size.*whole number[^\n]*$"):
        gymnasium.make(IDS[0], frame_size=size)


@pytest.mark.parametrize("env_id", [env_id for spec in CROWDS.values() for env_id in spec.ids.values()])
def test_the_caption_tells_the_distance_to_the_nearest_wall_or_body(env_id):
    env = gymnasium.make(env_id, render_mode="rgb_array").unwrapped
    _, info = env.reset(seed=1)
    forward, hit = np.zeros(env.action_space.shape), False
    forward[..., 0] = env.action_space.high[..., 0]
    for _ in range(600):
        _, _, terminated, _, info = env.step(forward)
        nearest = min(np.ravel(info["clearance"])[0], np.ravel(info["gap"])[0])
        told = env.scene().caption.partition("clearance")[2]
        assert told.strip() == (f"{nearest:.2f} m" if nearest < np.inf else "")
        hit = nearest < 0.0
        if hit or terminated:
            break
    assert hit, "the robot that goes straight on must have run into something"


def run_python(program: str, **environment: str) -> str:
    kept = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")}
    command = [sys.executable, "-c", program]
    return subprocess.run(command, env=kept | environment, capture_output=True, text=True, check=True).stdout


def test_arrays_need_no_display():
    program = """
import pygame
from wayfield.envs.rendering import Renderer, Scene
from wayfield.envs.robots import ROBOTS
from wayfield.envs.tasks.specs import CROWDS, EVERY
scene = Scene(robot=ROBOTS["omni3"], pose=(0.0, 0.0, 0.0), bounds=(-1.0, -1.0, 1.0, 1.0), caption="t = 0 s")
print(Renderer("rgb_array", fps=20).draw(scene).shape, pygame.display.get_init())
"""
    assert run_python(program).endswith("(640, 640, 3) False\n")


def test_without_pygame_the_error_says_what_to_install():
    program = """
import sys
sys.modules["pygame"] = None
try:
    import wayfield.envs.rendering
except Exception as error:
    print(type(error).__name__, error)
"""
    output = run_python(program)
    assert gymnasium.error.DependencyNotInstalled.__name__ in output
    assert installs("render") in output


def test_a_window_without_a_display_is_one_clear_error_and_the_dummy_driver_is_none():
    program = """
import gymnasium, wayfield
env = gymnasium.make("wayfield/DiffDrivePathFollowing-v0", render_mode="human")
try:
    env.reset(seed=0)
    print("drawn", env.unwrapped.batch.states["steps"][0])
except RuntimeError as error:
    print(error)
"""
    told = run_python(program)
    assert told.splitlines()[-1].startswith('render_mode="human" found no display')
    assert 'render_mode="rgb_array"' in told
    assert run_python(program, SDL_VIDEODRIVER="dummy").endswith("drawn 0\n")


def test_every_window_is_drawn_and_closed_for_itself_beside_those_of_others():
    program = """
import gymnasium, pygame, wayfield
ids = "wayfield/DiffDrivePathFollowing-v0", "wayfield/OmniDocking-v0"
pygame.display.init()
own = pygame.display.set_mode((90, 70))

def begin(k, size):
    env = gymnasium.make(ids[k], render_mode="human", frame_size=size)
    env.reset(seed=k)
    return env

def step(env):
    env.step(0 * env.action_space.high)
    window = env.unwrapped._renderer._window
    return window and window.get_surface().get_size()

a, b = begin(0, (320, 240)), begin(1, (400, 420))
print(step(a), step(b), step(a))
a.close()
c = begin(0, (300, 300))
print(step(b), step(c), step(b), own.get_size())
pygame.event.post(pygame.event.Event(pygame.WINDOWCLOSE, window=b.unwrapped._renderer._window))
print(step(c), step(b), step(c), step(b))
pygame.event.post(pygame.event.Event(pygame.QUIT))
print(step(c), step(c), c.render(), own.get_size(), pygame.event.peek(pygame.QUIT))
b.close()
b.reset(seed=0)
pygame.display.quit()  # theirs, and all of pygame's
d = begin(0, (300, 300))
print(step(d))
pygame.event.post(pygame.event.Event(pygame.QUIT))
print(step(d), pygame.event.peek(pygame.QUIT))
d.close()
d.reset()
print(step(d))
"""
    assert run_python(program, SDL_VIDEODRIVER="dummy").splitlines()[-7:] == [
        "(320, 240) (400, 420) (320, 240)",
        "(400, 420) (300, 300) (400, 420) (90, 70)",
        "(300, 300) None (300, 300) None",
        "None None None (90, 70) True",
        "(300, 300)",
        "None False",
        "(300, 300)",
    ]
