"""The sections of the page of results: the run behind each, and what is shown of it."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

from interval_coverage import COVERAGE, SUITE

from wayfield.benchmarks.contests import ALL_CONTESTS, CONTESTS, DISTURBANCES, Contest
from wayfield.benchmarks.records.results import TABLE
from wayfield.envs.robots import ROBOTS
from wayfield.policies.trained.ppo import shipped

RESULTS = "docs/results"  # folder of the tables and of what made them
ROWS = f"{RESULTS}/rows"  # of the episodes behind them, packed
DOCUMENTS = "documents"


@dataclasses.dataclass(frozen=True)
class Section:
    """One run of the page."""

    name: str  # of its folder
    title: str
    command: str
    tables: Mapping[str, str]  # file of the run: heading on the page
    not_shown: str
    pictures: Mapping[str, str] = dataclasses.field(default_factory=dict)  # file of the run: what it shows
    within: str = ""  # folder of its tables, with a slash, where another section has tables of these names
    needs: str = ""  # what its command takes and does not ship: it is run by hand
    columns: tuple[str, ...] = ()  # that the page shows of its tables, which are files too; none: all, of a single one

    @property
    def of_contest(self) -> bool:
        """Returns whether it shows contests, whose tables are made from the rows that are kept."""
        return any(f"--suite {name}" in self.command for name in (*ALL_CONTESTS, DISTURBANCES))

    @property
    def from_rows(self) -> bool:
        """Returns whether its tables are made from the rows that are kept."""
        return self.of_contest or self.name == DOCUMENTS

    @property
    def ladder(self) -> bool:
        """Returns whether it is about the levels of disturbance."""
        return f"--suite {DISTURBANCES}" in self.command

    def place(self, file: str) -> str:
        """Returns where the repository keeps a file of the run."""
        if file in self.pictures:
            return f"docs/{file}"
        return f"{RESULTS}/{self.name}_table.md" if file == TABLE else f"{RESULTS}/{self.within}{file}"


_MAP_NOTE = "Policies with the map have more inputs than the others. Simulation only."
_SPEED = "Simulation only; noise and disturbances are in the section of their own."
BOARD = "Leaderboard"
CLAIMS = "What the agents win, and what they do not"


def _tables(stem: str, more: Mapping[str, str] | None = None) -> dict[str, str]:
    """Returns the titles of a contest's tables, by file; `more` stands behind every number of every entry."""
    ends = {"_board": BOARD, "_pairs": CLAIMS, "": "Every number of every entry", **(more or {})}
    ends |= {"_told": "What each has", "_families": "By family", "_seeds": "Each agent by itself"}
    return {f"{stem}{end}.csv": title for end, title in ends.items()}


def _goals(robot: str, wheels: str) -> Section:
    """Returns the section of goal reaching with a robot."""
    name = "goal-obstacles" + ("" if robot == "p3dx" else f"-{robot}")
    stem = f"goal_obstacles_{robot}"
    return Section(
        name,
        f"Goal reaching among obstacles, {wheels}",
        "python evaluate.py --suite goal-obstacles" + ("" if robot == "p3dx" else f" --robot {robot}"),
        _tables(stem) | {f"{stem}_better.csv": "Better than, in pairs"},
        _MAP_NOTE,
    )


_MAIN = (
    Section(
        "path-following",
        "Path following",
        "python evaluate.py --suite path-following",
        _tables("path_following_p3dx", {"_front": "Asked for a speed (m/s)"})
        | {"path_following_p3dx_better.csv": "Better than, in pairs"},
        _SPEED,
        {"path_following_p3dx_front.png": "Speed and accuracy of the path followers, each swept over its speed"},
    ),
    _goals("p3dx", "P3DX"),
    _goals("omni3", "three omni wheels"),
    _goals("omni4", "four omni wheels"),
)


def _claims(contest: Contest, robot: str = "p3dx", policies: Sequence[str] = (), more: str = "") -> Section:
    """Returns the section of a contest with a robot, on the split that tells small differences."""
    stem, default = f"{contest.stem}_{robot}", robot == "p3dx"
    options = f"--split claims --policies {','.join(policies or contest.claims)}{more}"
    return Section(
        f"{contest.name}-claims" if default else f"{contest.name}-{robot}-claims",
        f"{contest.spec.title}, {'P3DX' if default else robot}, a hundred other scenarios a family",
        f"python evaluate.py --suite {contest.name}{'' if default else f' --robot {robot}'} {options}",
        _tables(stem),
        "Only the policies that are near the best; the section of the contest has all. Agents do not drive alone: what "
        "guards them, drives the last of the way or takes over is in the table of what each has.",
        within="claims/",
    )


_LEFT_OUT = {
    "trajectory-tracking": "All have the exact pose and the actuators of the sheet: with noise or slip the order is "
    "another. "
}


def _others() -> Iterator[Section]:
    """Yields a section for each contest that none above is about, with every robot that agents of it ship for."""
    there = {section.command.split()[-1] for section in _MAIN}
    for contest in CONTESTS.values():
        if contest.name in there:
            continue
        for robot in (each for each in ROBOTS if shipped(contest.spec.name, each)):
            default = robot == "p3dx"
            yield Section(
                contest.name if default else f"{contest.name}-{robot}",
                contest.spec.title if default else f"{contest.spec.title}, {robot}",
                f"python evaluate.py --suite {contest.name}"
                + ("" if default else f" --robot {robot}")
                + " --policies all" * bool(contest.on_request),
                {
                    f"{contest.stem}_{robot}_board.csv": BOARD,
                    f"{contest.stem}_{robot}_pairs.csv": CLAIMS,
                    f"{contest.stem}_{robot}.csv": "Every number of every entry",
                    f"{contest.stem}_{robot}_told.csv": "What each has",
                },
                f"{_LEFT_OUT.get(contest.name, '')}Simulation only.",
            )


SECTIONS = (
    *_MAIN,
    *_others(),
    *(_claims(contest) for contest in CONTESTS.values() if contest.claims),
    # whether the agent below the planner is better than the planner on bases that go sideways
    *(
        _claims(CONTESTS["goal-obstacles"], robot, ("vfh_plus", "scan_planner", "hybrid"))
        for robot in ("omni3", "omni4")
    ),
    # a hull of 0.57 m with gains of its own: scenes, clock and movers of its class
    _claims(CONTESTS["goal-obstacles"], "mir100", ("vfh_plus", "dwa", "scan_planner", "any_robot"), " --gains tuned"),
    Section(
        DISTURBANCES,
        "Under disturbances",
        f"python evaluate.py --suite {DISTURBANCES}",
        {
            file: heading
            for contest in CONTESTS.values()
            for file, heading in (
                (f"{contest.stem}_p3dx_ladder.csv", contest.spec.title),
                (f"{contest.stem}_p3dx_ladder_pairs.csv", f"{contest.spec.title}: {CLAIMS[0].lower()}{CLAIMS[1:]}"),
            )
        },
        "Five scenarios of each family a level: enough for intervals, too few to tell close policies apart. Of what "
        "had changed since the run, `ppo` and `stanley` on paths and `smooth_pose` and `mpc_pose` to docks drove again "
        "at commit 430ee4b9, `lqr` (tuned) at 67692995, `lqr` (robust) at 21c2e951, `ppo` and `reeds_shepp` to docks "
        "at 57fe86db; `ilqr` drove there.",
    ),
    Section(
        "barn",
        "The BARN challenge's worlds, Jackal",
        "python evaluate.py --suite barn --data BARN --policies scan_planner,any_robot,vfh_plus,dwa,astar_tracker",
        {
            "barn_jackal.csv": "By the challenge's rules",
            "barn_jackal_published.csv": "Beside what is published, of other simulations",
        },
        "Simulation without Gazebo: a proxy of the challenge's scores, and no rank among them. Gains were sought for "
        "scan_planner, by a search and then by hand, and for any_robot, by hand, in worlds of the same kind and none "
        "of these (`benchmarks/studies/barn_gains.py` of commit 83ab1a5). They drive at up to 2 m/s and foresee no "
        "motion, of which these worlds have none; the others have default gains and a target speed of 1.2 m/s. "
        "any_robot's planner has scan_planner's gains and drives most of the time, wherever the agent has made no way "
        "for a second. A world at the ceiling of the score (0.5) ranks nobody; of entries with many such worlds, the "
        "time beyond the ceiling and the clearances tell more.",
        needs="the official worlds of BARN",
        columns=(
            *("policy", "gains", "success (%)", "collision (%)", "timeout (%)", "SCT", "score (2, 8)"),
            *("at the ceiling (%)", "later than the ceiling (s)", "least clearance (m)", "smallest clearance (m)"),
            *("mean speed of successes (m/s)", "compute p99 (ms)"),
            *("year", "entry", "score", "source"),
        ),
    ),
    Section(
        "transfer",
        "Do gains hold where they were not tuned?",
        "python benchmarks/studies/transfer.py --data BARN",
        {"transfer.csv": "Goals reached (%)"},
        "Only policies with a tuned set for the robot; rooms are of our drawing, BARN's worlds those that we have.",
        needs="its script, which is that commit's",
        columns=("policy", "gains", "validation", "test", "rooms", "rooms, turtlebot3", "rooms, jackal", "BARN"),
    ),
    Section(
        "learners",
        "Learners beside each other",
        "python benchmarks/studies/learners.py",
        {"learners.csv": "Path following, P3DX"},
        "One task, few seeds, one set of numbers for all of PPO, chosen for the learner that begins with nothing; none "
        "of these agents ships.",
        needs="its script, which is that commit's",
        columns=("learner", "begins with", "success (%)", "typical (m)", "mean speed (m/s)", "above the law's (m)"),
    ),
    Section(
        SUITE,
        "How often the intervals hold",
        "python benchmarks/studies/interval_coverage.py",
        {COVERAGE: "Measured by simulation"},
        "The populations are made up after those of the suites; no interval tells of families that are not driven.",
    ),
    Section(
        DOCUMENTS,
        "The three reference papers",
        "python evaluate.py --suite documents",
        {TABLE: "Ours beside theirs", **{f"document_{each.lower()}.csv": f"Every run of {each}" for each in "ABC"}},
        "The documented gain of A is weak by design of the document, and C's field as printed arrives nowhere but on "
        "pymunk, in one scenario, where contacts and slip free it: beating either alone proves nothing.",
        {"document_a_trajectories.png": "P3DX look-ahead report: the controller as printed and corrected"},
    ),
)
