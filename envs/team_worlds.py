"""Teams: several robots in one world, each with a goal of its own, that see each other, among people."""

import dataclasses
import functools
import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.crowds.bodies import (
    CELLS_FROM,
    HULL,
    NEAREST,
    PLACE,
    ROBOT,
    STANDS_BELOW,
    Bodies,
    Frame,
    Sight,
    cells_for,
    chords_apart,
    find_nearest,
    lay_cells,
    note_neighbours,
    scan_bodies,
)
from wayfield.envs.crowds.people import (
    LAWS,
    REPLAY,
    WALK,
    WALKER,
    People,
    note_arrivals,
    note_hulls,
    note_people,
    place_people,
    scratch_for,
    walk_people,
)
from wayfield.envs.goal_reaching import (
    FLAGS,
    INFO,
    GoalReaching,
    World,
    all_but,
    assess,
    observe_goal,
    scan_maps,
    scanner,
    track_goal,
)
from wayfield.envs.robots import records, sensing
from wayfield.envs.robots.hulls import hull_clearance
from wayfield.envs.robots.kinematics import to_body_frame
from wayfield.envs.scenarios.bank import field_scenarios
from wayfield.envs.scenarios.recordings import is_recording, recorded
from wayfield.envs.scenarios.scenario import GoalScenario
from wayfield.envs.scenarios.team_scenario import TeamScenario, check_team
from wayfield.envs.tasks.arguments import WHEELS_OF_MUJOCO, ScanArguments, argument
from wayfield.envs.tasks.constraints import Constraint, at_least
from wayfield.envs.tasks.observation import Field, Layout
from wayfield.envs.tasks.specs import CROWDS, TASKS, TaskSpec
from wayfield.envs.tasks.stepping import Outputs, Reset, Robots, Step, Turn, drawn_scenario, numbered, step_worlds
from wayfield.envs.tasks.task import LARGEST_TEAMS, PLANTS, Options
from wayfield.envs.world.grids import Grids, clearance_around
from wayfield.system.checks import LONGEST, choose, positive, shown, suggestion, truth, whole
from wayfield.system.compiled import allocating, compiled, flattened, inlined
from wayfield.system.elementary import sin_cos, wrap_angle

ENDS = ("leave", "respawn")
SEES = ("scan", "bodies")
COLUMNS = 7  # numbers of a body in the observation
# of a track where range scans have their nominal noise: what a lidar tracker of people is off by
TRACK_POSITION_NOISE, TRACK_VELOCITY_NOISE = 0.02, 0.1  # m, m/s
TRACK_NOISE_COLUMNS = 5  # standard normal numbers of a body: x, y, vx, vy, and whether it is seen
CANDIDATES = 16  # starts that are drawn where a robot begins anew in a running world
SCATTER = 0.5  # m, by which they lie off the scenario's starts, at most
SPARE = 0.3  # m, that such a start has to all bodies and walls
DRAWS_EACH = 3

STATE = np.dtype(
    [
        *((name, goal_reaching.STATE.fields[name][0]) for name in goal_reaching.STATE.names),  # type: ignore[index,union-attr]
        ("before_x", np.float64),  # pose at the start of the period
        ("before_y", np.float64),
        ("before_heading", np.float64),
        ("gap", np.float64),  # m, the least distance of hulls to another body in this step; inf: none is near
        ("touched", np.int64),  # 0: nothing; 1: what stands; 2: a robot; 3: a person
        ("caused", np.int64),  # 1: it moved towards what it touched
        ("alive", np.int64),  # 0: its episode has ended
    ],
    align=True,
)

PARAMS = [
    *goal_reaching.PARAMS,
    ("team", np.int64),  # robots of a world
    ("people", np.int64),  # bodies besides, at most
    ("reach", np.float64),  # m, within which bodies are neighbours
    ("sight", np.float64),  # m, within which they are observed
    ("sees_bodies", np.int64),
    ("track_position_noise", np.float64),  # m
    ("track_velocity_noise", np.float64),  # m/s
    ("parks", np.int64),  # 1: robots stay where they arrive
    ("respawns", np.int64),
    ("cells_from", np.int64),
    ("forces", np.int64),  # 1: the plant keeps bodies apart; 0: who touches another stands where it was
]

CAUSES_FROM = 0.05  # m/s towards another body, above which a robot has caused a contact

TEAM_INFO = (*INFO, "gap", "touched")
TEAM_FLAGS = (*FLAGS, "caused")
NUMBER = numbered(*TEAM_INFO)
FLAG = numbered(*TEAM_FLAGS)


class Observation(NamedTuple):
    """What a robot of a team sees where bodies are tracked for it; b is any batch shape, t the twist components."""

    pose: NDArray[Any]  # (b, 3) measured x, y (m), heading (rad), world frame
    twist: NDArray[Any]  # (b, t) measured body twist, m/s and rad/s
    goal: NDArray[Any]  # (b, 2) the waypoint or goal driven to, body frame, m
    goal_heading_error: NDArray[Any]  # (b,) goal heading minus heading, rad
    waypoints_left: NDArray[Any]  # (b,) before the goal
    # (b, 10, 7) the nearest bodies in sight, the nearest first, body frame: x, y (m), vx, vy (m/s, over ground), radius
    # (m), kind (1 robot, 2 person), seen (1; 0: the row is empty)
    bodies: NDArray[Any]
    ranges: NDArray[Any]  # (b, beams) m, at most max_range

    @staticmethod
    def less() -> type:
        """Returns the observation without bodies."""
        return goal_reaching.Observation

    def without_bodies(self) -> goal_reaching.Observation:
        """Returns the fields but for the bodies."""
        return goal_reaching.Observation(*self[:5], self.ranges)

    @staticmethod
    def layout(num_twist: int, num_beams: int, max_range: float, task: TaskSpec) -> "Layout[Observation]":
        """Returns the order of the fields in the flat observation."""
        *first, ranges = goal_reaching.Observation.layout(num_twist, num_beams, max_range, task).fields
        bodies = Field("bodies", (NEAREST, COLUMNS), -np.inf, np.inf)
        return Layout(Observation, (*first, bodies, ranges), task)


class TeamBank(NamedTuple):
    """The arrays that describe the bank: the first five as `goal_reaching.Bank`, of scenarios x team."""

    courses: NDArray[np.void]
    goals: NDArray[np.float64]
    fields: NDArray[np.void]
    cells: NDArray[np.uint8]
    beams: NDArray[np.float64]
    walks: NDArray[np.void]  # (scenarios, people) WALK records
    tracks: NDArray[np.float64]  # of all recordings


class Company(NamedTuple):
    """The arrays that the worlds keep besides the states of their robots; m bodies are robots and people."""

    near_places: NDArray[np.void]  # (2, worlds, m) PLACE records: the snapshots
    hulls: NDArray[np.void]  # (worlds, m) HULL records
    near: NDArray[np.int64]  # (worlds, m, NEAREST)
    counts: NDArray[np.int64]  # (worlds, m)
    clocks: NDArray[np.int64]  # (worlds, 2): which snapshot is now, and steps
    walkers: NDArray[np.void]  # (worlds, people) WALKER records


class Crowd(NamedTuple):
    """What a step keeps of the worlds, and room for a thread."""

    bodies: Bodies
    people: People
    cells: Any
    lines: Any
    frame: NDArray[np.float64]  # (5,) of the cells of the world that is being stepped


# ---- the phases


@compiled
def begin_step(p, robots, crowd, world, w):
    """Notes where the robots of a world stand, removes those that have arrived, and lets its people decide and walk."""
    bodies = crowd.bodies
    n = p.team
    for i in range(w * n, (w + 1) * n):
        s = robots.states[i]
        if s.alive == 0 and s.contact == 0 and p.parks == 0:
            bodies.places[bodies.clocks[w, 0], w, i - w * n].present = 0
        s.before_x = s.x
        s.before_y = s.y
        s.before_heading = s.heading
        s.touched = 0
        s.caused = 0
        s.gap = np.inf
    if p.people > 0:
        s = robots.states[w * n]
        around = (robots.obstacles, s.field, s.num_obstacles)
        time = bodies.clocks[w, 1] * p.dt
        now = bodies.clocks[w, 0]
        walk_people(bodies, crowd.people, now, w, s.scenario // n, n, around, crowd.lines, time, p.dt)


@inlined
def note_place(p, s, before, place, present):
    """Writes where a robot is into the next snapshot; its velocity is that over ground of the period."""
    sine, cosine = sin_cos(s.heading)
    place.x = s.x
    place.y = s.y
    place.cos = cosine
    place.sin = sine
    place.vx = (s.x - before.x) / p.dt
    place.vy = (s.y - before.y) / p.dt
    place.present = present
    stands = place.vx * place.vx + place.vy * place.vy < STANDS_BELOW * STANDS_BELOW
    place.stood = before.stood + p.dt if stands else 0.0


@compiled
def exchange(p, robots, crowd, world, skip, w):
    """Writes the next snapshot of a world, ends robots in contact, and finds the neighbours of all."""
    bodies = crowd.bodies
    places_of = bodies.places
    n = p.team
    now = bodies.clocks[w, 0]
    to = 1 - now
    for r in range(n):
        i = w * n + r
        s = robots.states[i]
        before = places_of[now, w, r]
        note_place(p, s, before, places_of[to, w, r], before.present)
        if not skip[i] and s.contact:
            s.touched = 1
    note_people(bodies, crowd.people, now, to, w, n, p.dt)
    for r in range(n):
        i = w * n + r
        s = robots.states[i]
        if skip[i]:
            continue
        for k in range(bodies.counts[w, r]):
            j = bodies.near[w, r, k]
            a = places_of[now, w, r]
            b = places_of[now, w, j]
            to_a = places_of[to, w, r]
            to_b = places_of[to, w, j]
            if to_b.present == 0:
                continue
            gap = chords_apart(a, to_a, b, to_b) - (p.hull_radius + bodies.hulls[w, j].reach)
            s.gap = min(s.gap, gap)
            if gap < 0.0:
                s.touched = max(s.touched, 1 + bodies.hulls[w, j].kind)
                if j < n and not skip[w * n + j]:
                    # whose own neighbours may be nearer ones
                    robots.states[w * n + j].touched = max(robots.states[w * n + j].touched, 1 + ROBOT)
                x = b.x - a.x
                y = b.y - a.y
                distance = max(math.sqrt(x * x + y * y), 1e-12)
                if x * to_a.vx + y * to_a.vy > CAUSES_FROM * distance:
                    s.caused = 1
    for r in range(n):
        i = w * n + r
        s = robots.states[i]
        if not skip[i] and s.touched > 1:
            s.contact = 1
            if p.forces:
                continue
            # both stand at the start of the period
            s.x = s.before_x
            s.y = s.before_y
            s.heading = s.before_heading
            records.stop(s)
            s.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)
            note_place(p, s, places_of[now, w, r], places_of[to, w, r], 1)
    bodies.clocks[w, 1] += 1
    if p.people > 0:
        scenario = robots.states[w * n].scenario // n
        note_arrivals(bodies, crowd.people, to, w, scenario, n, bodies.clocks[w, 1] * p.dt)
    bodies.clocks[w, 0] = to
    look_around(p, robots, crowd, w)


@compiled
def look_around(p, robots, crowd, w):
    """Lays the cells of a world and finds the neighbours of all of its bodies."""
    bodies = crowd.bodies
    now = bodies.clocks[w, 0]
    frame = lay_cells(bodies.places, now, w, crowd.cells, p.cells_from)
    note_neighbours(
        bodies,
        now,
        w,
        p.reach,
        Sight(robots.obstacles, 0, 0, robots.grids.frames, 0, robots.grids.cells, 0),
        crowd.cells,
        frame,
    )
    crowd.frame[0] = frame.x
    crowd.frame[1] = frame.y
    crowd.frame[2] = frame.size
    crowd.frame[3] = frame.nx
    crowd.frame[4] = frame.ny


@inlined
def observe(p, s, course, world, robots, crowd, i, row, out):
    """Writes the observation of one robot; what grids hold is for `goal_reaching.scan_maps`."""
    k = observe_goal(p, s, course, world, robots, i, row, out)
    w = i // p.team
    r = i - w * p.team
    f = crowd.frame
    frame = Frame(f[0], f[1], f[2], int(f[3]), int(f[4]))
    if p.sees_bodies == 1:
        observe_bodies(p, s, robots, crowd, frame, w, i, row, out, k)
        k += NEAREST * COLUMNS
    lidar = world.lidar
    pose = (s.x, s.y, s.heading)
    sensing.scan_ranges(lidar, robots.obstacles, s.field, s.num_obstacles, s.num_blocks, pose, out, i, k)
    if crowd.bodies.places.shape[2] > 1 and lidar.beams.shape[1] > 0:
        scan_bodies(lidar, crowd.bodies, w, r, crowd.cells, frame, pose, out, i, k)
    if robots.grids.cells.shape[0] == 0:
        goal_reaching.disturb_ranges(p, lidar, robots.noise, i, row, out, k)


@compiled
def observe_bodies(p, s, robots, crowd, frame, w, i, row, out, column):
    """Writes the nearest bodies that a robot sees, from a column on, with the noise of tracks."""
    bodies = crowd.bodies
    now = bodies.clocks[w, 0]
    maps = 1 if robots.grids.cells.shape[0] > 0 else 0
    seen = Sight(robots.obstacles, s.field, s.num_obstacles, robots.grids.frames, s.scenario, robots.grids.cells, maps)
    count = find_nearest(bodies, now, w, i - w * p.team, p.sight, seen, crowd.cells, frame)
    sine, cosine = sin_cos(s.heading)
    for c in range(column, column + NEAREST * COLUMNS):
        out[i, c] = 0.0
    noise = robots.noise
    first = noise.shape[2] - NEAREST * TRACK_NOISE_COLUMNS  # behind those of the beams
    at = column
    for k in range(count):
        n = first + TRACK_NOISE_COLUMNS * k
        if p.dropout_below > -np.inf and noise[i, row, n + 4] < p.dropout_below:
            continue
        j = crowd.cells.nearest[k]
        place = bodies.places[now, w, j]
        hull = bodies.hulls[w, j]
        x, y = to_body_frame(s.x, s.y, sine, cosine, place.x, place.y)
        vx = cosine * place.vx + sine * place.vy
        vy = cosine * place.vy - sine * place.vx
        if p.track_position_noise > 0.0:
            x += p.track_position_noise * noise[i, row, n]
            y += p.track_position_noise * noise[i, row, n + 1]
            vx += p.track_velocity_noise * noise[i, row, n + 2]
            vy += p.track_velocity_noise * noise[i, row, n + 3]
        out[i, at] = x
        out[i, at + 1] = y
        out[i, at + 2] = vx
        out[i, at + 3] = vy
        out[i, at + 4] = hull.reach
        out[i, at + 5] = hull.kind
        out[i, at + 6] = 1.0
        at += COLUMNS


@inlined
def judge(p, s, world, robots, crowd, i, row, outputs):
    """Measures robot i against its goal and writes its observation, info and flags; a robot that has arrived leaves."""
    course = world.courses[s.scenario]
    before = s.remaining_distance
    turn_before = abs(s.goal_heading_error)
    track_goal(s, course, world.goals)
    observe(p, s, course, world, robots, crowd, i, row, outputs.out)
    assess(p, s, course, before, turn_before, outputs, i)
    note_meeting(s, outputs, i)
    if outputs.flags[outputs.flags.shape[0] - 1, i]:
        s.alive = 0


@inlined
def note_meeting(s, outputs, i):
    """Writes what a robot had to do with others in this step."""
    outputs.numbers[NUMBER.gap, i] = s.gap
    outputs.numbers[NUMBER.touched, i] = s.touched
    outputs.flags[FLAG.caused, i] = s.caused == 1


# ---- the reset


@inlined
def place_robot(p, s, world, robots, i, draws, j):
    """Puts a robot where its scenario says, at rest."""
    goal_reaching.place(p, s, world, robots, i, draws, j)
    settle(p, s, robots, i, draws, j)


@inlined
def settle(p, s, robots, i, draws, j):
    """Lets a robot begin at its pose."""
    records.halt(s)
    records.draw_shove(p, s, draws, j)
    s.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)
    s.alive = 1
    s.gap = np.inf
    s.touched = 0
    s.caused = 0


@inlined
def begin_body(p, s, bodies, w, r):
    """Writes a robot at rest into both snapshots of its world: what is not yet over and what comes next."""
    for t in range(2):
        place = bodies.places[t, w, r]
        sine, cosine = sin_cos(s.heading)
        place.x = s.x
        place.y = s.y
        place.cos = cosine
        place.sin = sine
        place.vx = 0.0
        place.vy = 0.0
        place.stood = 0.0
        place.present = 1


@inlined
def begin(p, s, world, robots, crowd, i, outputs):
    """Writes the first observation and numbers of robot i."""
    course = world.courses[s.scenario]
    s.waypoint = 0
    track_goal(s, course, world.goals)
    observe(p, s, course, world, robots, crowd, i, np.int64(0), outputs.out)
    goal_reaching.report(p, s, 0.0, 0.0, 0.0, outputs.numbers, i)
    note_meeting(s, outputs, i)
    s.noise_row = 1
    outputs.flags[:, i] = False


@inlined
def begin_world(p, robots, crowd, world, w, draws, j, outputs):
    """Begins the world whose first robot's draws are in row j: all of its robots and people."""
    bodies = crowd.bodies
    n = p.team
    scenario = drawn_scenario(draws, j, world.courses.shape[0] // n)
    for r in range(n):
        i = w * n + r
        s = robots.states[i]
        s.scenario = scenario * n + r
        place_robot(p, s, world, robots, i, draws, j + r)
        begin_body(p, s, bodies, w, r)
        hull = bodies.hulls[w, r]
        hull.half_length = 0.5 * p.hull_length
        hull.half_width = 0.5 * p.hull_width
        hull.ahead = p.hull_x
        hull.radius = p.hull_radius if p.hull_length == 0.0 else 0.0
        hull.reach = p.hull_radius
        hull.kind = ROBOT
        hull.blind = 0
    bodies.clocks[w, 0] = 0
    bodies.clocks[w, 1] = 0
    if p.people > 0:
        place_people(crowd.people, scenario, w)
        note_hulls(bodies, crowd.people, w, scenario, n)
        for t in range(2):
            for k in range(p.people):
                bodies.places[t, w, n + k].cos = 1.0
                bodies.places[t, w, n + k].sin = 0.0
                bodies.places[t, w, n + k].stood = 0.0
            note_people(bodies, crowd.people, t, t, w, n, 0.0)
    look_around(p, robots, crowd, w)
    for r in range(n):
        begin(p, robots.states[w * n + r], world, robots, crowd, w * n + r, outputs)


@inlined
def room_at(p, robots, crowd, s, i, w, r, x, y):
    """Returns how far (m) the disc of a robot at (x, y) would be from all walls and bodies."""
    bodies = crowd.bodies
    now = bodies.clocks[w, 0]
    room = clearance_around(robots, i, s, x, y) - p.hull_radius
    for j in range(bodies.places.shape[2]):
        place = bodies.places[now, w, j]
        if j != r and place.present == 1:
            dx = place.x - x
            dy = place.y - y
            room = min(room, math.sqrt(dx * dx + dy * dy) - p.hull_radius - bodies.hulls[w, j].reach)
    return room


@inlined
def begin_anew(p, robots, crowd, world, i, draws, j, outputs):
    """Begins one robot anew in its running world: at the first of the drawn starts that is clear, else the clearest."""
    bodies = crowd.bodies
    n = p.team
    w = i // n
    r = i - w * n
    s = robots.states[i]
    base = s.scenario // n * n
    best = -np.inf
    x = s.x
    y = s.y
    for k in range(CANDIDATES):
        at = 1 + goal_reaching.DRAWS + DRAWS_EACH * k
        of = base + int(min(draws[j, at] * n, n - 1.0))
        start = world.courses[of].start
        to_x = start[0] + SCATTER * (2.0 * draws[j, at + 1] - 1.0)
        to_y = start[1] + SCATTER * (2.0 * draws[j, at + 2] - 1.0)
        room = room_at(p, robots, crowd, s, i, w, r, to_x, to_y)
        if room > best:
            best = room
            x = to_x
            y = to_y
            s.scenario = of
        if room >= SPARE:
            break
    s.x = x
    s.y = y
    s.heading = wrap_angle(world.courses[s.scenario].start[2])
    settle(p, s, robots, i, draws, j)
    begin_body(p, s, bodies, w, r)
    look_around(p, robots, crowd, w)
    begin(p, s, world, robots, crowd, i, outputs)


# ---- all robots


@allocating
def gathered(params, states, obstacles, noise, bank, company):
    """Returns the world, the robots and the crowd of a call, with room for its thread."""
    world = World(bank.courses, bank.goals, bank.fields, scanner(params[0], bank.beams, bank.cells))
    robots = Robots(params, states, obstacles, noise, Grids(bank.courses, bank.cells))
    people = People(bank.walks, bank.tracks, company.walkers)
    bodies = Bodies(company.near_places, company.hulls, company.near, company.counts, company.clocks)
    sorted_in = cells_for(bodies.places.shape[2], obstacles)
    return world, robots, Crowd(bodies, people, sorted_in, scratch_for(bank.fields.shape[1]), np.zeros(5))


@flattened(allocating)
def step_rows(phases: int, turn: Turn, step: Step, bank: TeamBank, company: Company, outputs: Outputs) -> Any:
    """Runs `stepping.step_worlds`."""
    world, robots, crowd = gathered(step.params, step.states, step.obstacles, step.noise, bank, company)
    conclude = goal_reaching.conclude
    return step_worlds(
        begin_step, exchange, judge, conclude, phases, turn, robots, crowd, step.actions, step.skip, world, outputs
    )


@flattened(allocating)
def reset_rows(reset: Reset, bank: TeamBank, company: Company, outputs: Outputs) -> None:
    """Begins worlds all of whose robots are in `rows`, ascending; where robots respawn, others in a running world."""
    p = reset.params[0]
    world, robots, crowd = gathered(reset.params, reset.states, reset.obstacles, reset.noise, bank, company)
    n = p.team
    j = 0
    while j < reset.rows.shape[0]:
        w = reset.rows[j] // n
        last = j
        while last < reset.rows.shape[0] and reset.rows[last] // n == w:
            last += 1
        if last - j == n:
            begin_world(p, robots, crowd, world, w, reset.draws, j, outputs)
        else:
            for k in range(j, last):
                begin_anew(p, robots, crowd, world, reset.rows[k], reset.draws, k, outputs)
        j = last
    if bank.cells.shape[0] > 0:
        count = reset.states.shape[0]
        scan_maps(p, world.lidar, robots, (all_but(reset.rows, count), 0, count), outputs.out)


# ---- the task


@dataclasses.dataclass(frozen=True, kw_only=True)
class TeamArguments(ScanArguments):
    """What an environment of several bodies takes."""

    scenario: Any = argument(
        "circle_8", 'a family ("doorway_4/test"), `TeamScenario`s; for one robot also any of goal reaching'
    )
    team: int | None = argument(None, "robots of a world, at most those of the scenario; None: all")
    sees: str = argument("scan", 'or "bodies" besides')
    ends: str = argument("leave", 'or "respawn": see Episode end')
    parks: bool = argument(False, "whether who has arrived stays")
    sight: float = argument(5.0, "m, within which bodies are observed")
    visible: bool | None = argument(None, "whether people see robots; None: as the scenario says")
    dynamics: str = argument(  # type: ignore[misc]
        "kinematic", '"mujoco": in MuJoCo, up to 8 robots; people have no body there'
    )
    wheels: str | None = WHEELS_OF_MUJOCO  # type: ignore[misc]
    people: str | None = argument(
        None, "the law of all who walk, of `wayfield.envs.crowds.people.LAWS`; None: as the scenario says"
    )

    def __post_init__(self) -> None:
        if self.dynamics in PLANTS and self.dynamics not in LARGEST_TEAMS:
            few = " or ".join(map(repr, LARGEST_TEAMS))
            raise ValueError(f"dynamics is {self.dynamics!r}, which drives one robot; for teams and people it is {few}")
        choose("ends", self.ends, ENDS)
        choose("sees", self.sees, SEES)
        truth("parks", self.parks)
        if self.visible is not None:
            truth("visible", self.visible)
        if self.people is not None:
            choose("people", self.people, [name for name in LAWS if LAWS[name] != REPLAY])
        positive("sight", self.sight, most=LONGEST)
        if self.team is not None:
            whole("team", self.team, 1)


class Teams(GoalReaching):
    """The task of a team of robots on a bank of worlds: a row is robot i mod n of world i div n."""

    state_dtype = STATE
    info_names = TEAM_INFO
    flag_names = TEAM_FLAGS
    step_rows = staticmethod(step_rows)
    reset_rows = staticmethod(reset_rows)
    belongs_to = CROWDS["teams"]
    param_fields = PARAMS

    def __init__(self, arguments: TeamArguments, options: Options) -> None:
        self._arguments = dataclasses.replace(arguments, scenario=None)  # the bank keeps those that were given
        self.ends, self.parks = arguments.ends, arguments.parks
        self._set = {
            "sight": float(arguments.sight),
            "sees_bodies": arguments.sees == "bodies",
            "parks": arguments.parks,
            "respawns": arguments.ends == "respawn",
            "cells_from": CELLS_FROM,
            "forces": options.dynamics != "kinematic",
        }
        super().__init__(arguments, options)
        if self.team > (most := LARGEST_TEAMS[options.dynamics]):
            raise ValueError(
                f'the world has {self.team} robots; dynamics="{options.dynamics}" drives at most {most:g}: give a team '
                "of so many, or another scenario"
            )
        if self.ends == "respawn":
            self.draws = goal_reaching.DRAWS + DRAWS_EACH * CANDIDATES
            if self.params["moving"][0]:
                raise ValueError(
                    f'ends="respawn" needs a scenario in which nothing patrols, got {shown(arguments.scenario)}'
                )
        walks = np.zeros((len(self.scenarios), self.most_people), WALK)
        tracks = {id(each.tracks): each.tracks for each in self.scenarios}  # those of a recording share one array
        begins = dict(zip(tracks, itertools.accumulate(map(len, tracks.values()), initial=0), strict=False))
        for row, each in zip(walks, self.scenarios, strict=True):
            row[: len(each.walks)] = each.walks
            row["first"] += begins[id(each.tracks)]
        every = np.ascontiguousarray(np.concatenate(list(tracks.values())))
        self.world = TeamBank(**self.world._asdict(), walks=walks, tracks=every)

    @property
    def of_states(self) -> tuple[Constraint, ...]:
        """Returns the distance of hull and obstacles, and of hulls."""
        return (*super().of_states, at_least("gap", "gap"))

    def bank(self, scenario: Any, hull_radius: float) -> tuple[TeamScenario, ...]:
        """Returns the scenarios of a name, or those given, all with one number of robots.

        Args:
            scenario: a name of the task's families; one that goal reaching has, for a robot alone; a recording of
                people, `recordings.recorded`; a `TeamScenario`, or several.

        Raises:
            ValueError: if the name is unknown, or starts, goals or numbers of robots do not fit.
        """
        if isinstance(scenario, TeamScenario):
            scenario = (scenario,)
        if isinstance(scenario, Sequence) and not isinstance(scenario, str):
            for i, each in enumerate(scenario):
                if not isinstance(each, TeamScenario):
                    raise ValueError(f"scenario[{i}] is {shown(each)}; it must be a TeamScenario")
                check_team(each, hull_radius)
            scenarios = tuple(scenario)
        elif isinstance(scenario, str) and scenario.partition("/")[0] in self._families():
            name = scenario.partition("/")[0]
            spec = next(each for each in CROWDS.values() if name in each.families or name in each.presets)
            scenarios = field_scenarios(spec, scenario, hull_radius)
        elif is_recording(scenario):
            scenarios = recorded(scenario)
            for each in scenarios:
                check_team(each, hull_radius)
        else:
            goals = self._goals(scenario, hull_radius)
            scenarios = tuple(TeamScenario(each.name, (each,), tier=each.tier, family=each.family) for each in goals)
        if not scenarios:
            raise ValueError("scenario must be a name or at least one TeamScenario, got none")
        team = self._arguments.team or scenarios[0].team
        return tuple(each.of(team).walked(self._arguments.visible, self._arguments.people) for each in scenarios)

    def _families(self) -> list[str]:
        return [name for spec in CROWDS.values() for name in (*spec.presets, *spec.families)]

    def _goals(self, scenario: Any, hull_radius: float) -> tuple[GoalScenario, ...]:
        """Returns the goal scenarios of a name, for a robot alone; ValueError names the families of teams too."""
        try:
            return field_scenarios(TASKS["goal_reaching"], scenario, hull_radius)
        except ValueError as error:
            if str(error).startswith("unknown"):
                near = suggestion(scenario, self._families())
                names = ", ".join(self.belongs_to.families)
                raise ValueError(
                    f"unknown {self.belongs_to.kind} scenario {shown(scenario)}.{near} The families are {names}; a "
                    "robot alone may have any scenario of goal reaching."
                ) from None
            raise

    @functools.cached_property
    def team(self) -> int:
        """Returns how many robots a world has."""
        return int(self.scenarios[0].team)

    def present(self, states: NDArray[np.void]) -> NDArray[np.bool_]:
        """Returns which robots (b,) have not left their worlds: as `begin_step` says."""
        return np.asarray((states["alive"] != 0) | (states["contact"] != 0) | self.parks)

    @functools.cached_property
    def most_people(self) -> int:
        """Returns how many people a world has, at most."""
        return max(len(each.walks) for each in self.scenarios)

    @property
    def further(self) -> dict[str, Any]:  # type: ignore[override]
        """Returns the parameters that are not those of goal reaching."""
        reach = max(max(each.reach for each in self.scenarios), float(self._set["sight"]))
        level = self.options.noise + self.options.disturbance.range_noise
        return {
            "team": self.team,
            "people": self.most_people,
            "reach": reach,
            "track_position_noise": TRACK_POSITION_NOISE * level,
            "track_velocity_noise": TRACK_VELOCITY_NOISE * level,
            **self._set,
        }

    @property
    def noise_columns(self) -> int:
        """Returns how many random numbers the tracks of bodies take in a step."""
        return NEAREST * TRACK_NOISE_COLUMNS if self._set["sees_bodies"] else 0

    @functools.cached_property
    def _courses(self) -> tuple[GoalScenario, ...]:
        return tuple(robot for each in self.scenarios for robot in each.robots)

    def courses_of(self) -> tuple[GoalScenario, ...]:
        """Returns the goals of each robot of each scenario, in the order of states["scenario"]."""
        return self._courses

    def observed(self, num_beams: int, max_range: float) -> Layout[Any]:
        """Returns the layout of what a robot observes."""
        kind = Observation if self._arguments.sees == "bodies" else goal_reaching.Observation
        return kind.layout(len(self.robot.twist_axes), num_beams, max_range, self.belongs_to)

    def own_arrays(self, num_envs: int) -> Company:
        """Returns snapshots, hulls, neighbours and people of the worlds.

        Raises:
            ValueError: if the rows are no whole number of worlds.
        """
        worlds, rest = divmod(num_envs, self.team)
        if rest:
            raise ValueError(
                f"num_envs={num_envs} with team={self.team}: rows are the robots of worlds, one behind the other; "
                f"num_envs must be a multiple of {self.team}"
            )
        m = self.team + self.most_people
        return Company(
            np.zeros((2, worlds, m), PLACE),
            np.zeros((worlds, m), HULL),
            np.zeros((worlds, m, NEAREST), np.int64),
            np.zeros((worlds, m), np.int64),
            np.zeros((worlds, 2), np.int64),
            np.zeros((worlds, self.most_people), WALKER),
        )

    def scenario_of(self, states: NDArray[np.void]) -> NDArray[np.int64]:
        """Returns which scenario (b,) of the bank the worlds of robots have."""
        return np.asarray(states["scenario"] // self.team)

    def same_world(self, name: str, values: NDArray[Any], there: NDArray[Any]) -> NDArray[np.bool_]:
        """Returns whether robots are in the same world: one that respawned in it may have another's way."""
        if name in ("scenario", "field"):
            return np.asarray(values // self.team == there // self.team)
        return super().same_world(name, values, there)

    def check_own(self, own: tuple[NDArray[Any], ...], there: tuple[NDArray[Any], ...]) -> None:
        """Raises ValueError, naming the field, unless snapshots and people of a file can be those of the worlds."""
        places_of, hulls, near, counts, clocks, walkers = own
        if hulls.tobytes() != there[1].tobytes():
            raise ValueError("hulls are other ones than those of the scenarios")
        for name, values, least, most in (
            ("near", near, 0, hulls.shape[1] - 1),
            ("counts", counts, 0, NEAREST),
            ("clocks", clocks[:, 0], 0, 1),
            ("clocks", clocks[:, 1], 0, 2**52),
            ("present", places_of["present"], 0, 1),
            ("walkers.present", walkers["present"], 0, 1),
            ("walkers.laps", walkers["laps"], 0, 2**52),
            *((name, each[name], -1e6, 1e6)
              for each in (places_of, walkers)
              for name in each.dtype.names or () if each.dtype[name].kind == "f"),
        ):  # fmt: skip
            good = (values >= least) & (values <= most)
            if not good.all():
                raise ValueError(f"{name} is {values[~good][0]}; it must be from {least:g} to {most:g}")

    def drawing(self, state: NDArray[np.void]) -> dict[str, Any]:
        """Returns what a frame shows of the task but for the other bodies, as fields of `rendering.Scene`."""
        drawn = super().drawing(state)
        scenario = self.scenarios[int(state["scenario"]) // self.team]
        x0, y0, x1, y1 = drawn["bounds"]
        margin = 2.0 * self.robot.hull_radius
        ways = [scenario.starts[:, :2], scenario.goals[:, :2], scenario.tracks[scenario.walked_rows, :2]]
        walks = scenario.walks
        ways += [np.column_stack([walks[x], walks[y]]) for x, y in (("x", "y"), ("goal_x", "goal_y"))]
        points = np.vstack(ways)
        low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
        return drawn | {"bounds": (min(x0, low[0]), min(y0, low[1]), max(x1, high[0]), max(y1, high[1]))}

    def room(self, state: NDArray[np.void]) -> float:
        """Returns the distance (m) of the robot's hull to the nearest obstacle or body; inf: none is near."""
        return min(super().room(state), float(state["gap"]))

    def others(
        self, states: NDArray[np.void], own: Any, i: int
    ) -> tuple[list[tuple[int, tuple[float, float, float], tuple[float, float], bool]], NDArray[np.float64]]:
        """Returns the other bodies in robot i's world: number, pose, goal and whether it left of robots, and people.

        People are (q, 4): x, y (m), heading (rad), radius (m).

        Args:
            states: (b,) of all robots.
            own: as `own_arrays` makes them.
        """
        w, r = divmod(i, self.team)
        there = own.near_places[own.clocks[w, 0], w]
        goals = self.scenarios[int(states["scenario"][i]) // self.team].goals[:, :2].tolist()
        robots = []
        for j in range(self.team):
            if j != r:
                x, y, heading = (float(states[name][w * self.team + j]) for name in ("x", "y", "heading"))
                robots.append((j, (x, y, heading), (goals[j][0], goals[j][1]), there["present"][j] == 0))
        people = np.flatnonzero(there["present"][self.team :]) + self.team
        headings = np.arctan2(there["sin"], there["cos"])
        return robots, np.column_stack([there["x"], there["y"], headings, own.hulls["reach"][w]])[people]

    def walking(self, own: Company) -> NDArray[np.float64]:
        """Returns where the people of all worlds are, (worlds, q, 5): x, y (m), vx, vy (m/s), 1 where one is there."""
        there = own.near_places[own.clocks[:, 0], np.arange(len(own.clocks)), self.team :]
        return np.stack([there[name] for name in ("x", "y", "vx", "vy", "present")], axis=-1)

    def briefing_fields(self, states: NDArray[np.void], knows: str) -> dict[str, Any]:
        """Returns the task's part of the briefing, with the size of the team and how far bodies are seen."""
        return super().briefing_fields(states, knows) | {"team": self.team, "sight": float(self._set["sight"])}
