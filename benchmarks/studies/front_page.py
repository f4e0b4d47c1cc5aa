"""README's part of the results: who wins at four tasks, one figure and four sentences, from the kept rows alone."""

import dataclasses
import io
import itertools
import re
from collections.abc import Iterator, Sequence
from typing import Any

import flocks
import gymnasium
import matplotlib
import numpy as np
import part_rows
from flocks import AHEAD, BEHIND
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image, ImageDraw
from results_page import LEARNED, ONLY_MAP, README, Row, Store, at_pace, best_sets, entry_of, marked, verdict_of
from sections import RESULTS

from wayfield import policies
from wayfield.benchmarks.contests import PACE_TOLERANCE
from wayfield.benchmarks.figures.drawing import RC
from wayfield.benchmarks.leaderboards.verdicts import BETTER, EQUIVALENT, OPEN, SLOWER, WORSE, Verdict
from wayfield.benchmarks.statistics.aggregates import interval, mean
from wayfield.envs.tasks.task import CONTROL_PERIOD
from wayfield.policies.trained.ppo import shipped

FIGURE, FILM = "docs/who_wins.png", "docs/drive.webp"
FILMED = "moving_crowd/test"
FRAME_PX, FRAME_SKIP, PACE_SHOWN = 480, 4, 2.0  # of each side; steps a frame; times the robots' own pace
CONTROLLER, AGENT = "#0072B2", "#E69F00"  # of Okabe and Ito, apart for colour-blind readers
SUCCESS = "success (%)"
SIDES = "controller", "agent"
PPO = "ppo"  # whose success is told where another agent is the best


@dataclasses.dataclass(frozen=True)
class Bar:
    """What an entry comes to, with its 95 % interval."""

    name: str  # as a sentence has it
    value: float
    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class Match:
    """The best controller beside the best agent in a kind of scenes."""

    where: str
    controller: Bar
    agent: Bar
    scenes: int
    outcome: str  # of the controller: BETTER, WORSE, EQUIVALENT, OPEN; AHEAD or BEHIND by the interval alone
    speeds: tuple[float, float] | None = None  # m/s, where they differ
    shares: tuple[float, float] | None = None  # of success (%), where these decide and errors are drawn
    faster: str = ""  # of two that are equivalent in success or never fail: by what the time decides for the better one
    sooner: str = ""  # of two that tie in success: which of them is significantly faster
    collided: tuple[float, float] | None = None  # shares of scenes (%), where successes are drawn
    ppo: str = ""  # what is said of its success, where another agent is the best


@dataclasses.dataclass(frozen=True)
class Panel:
    """A task: a panel of the figure and a sentence."""

    title: str
    axis: str
    unit: str
    scenes: str  # the noun
    win: str  # a sentence's words, of a winner, a loser and where
    matches: tuple[Match, ...]


_PATHS, _TIMED = "claims/path_following_p3dx", "trajectory_tracking_p3dx"
_GOALS, _DOCKS = "claims/goal_obstacles_p3dx", "claims/docking_p3dx"
# The kinds of scenes of a task: the leaderboard of each and how that calls it, and how README does.
_TASKS: tuple[tuple[str, str, str, str, str, tuple[tuple[str, str, str], ...]], ...] = (
    (
        "Path following", "RMS error (mm), lower is better", "mm", "paths",
        "{} tracks {where} more closely than {}",
        ((_PATHS, "smooth paths", "smooth paths"), (_PATHS, "paths with corners", "paths with corners"),
         (_TIMED, "references that a base can follow", "timed trajectories")),
    ),
    (
        "Goal reaching", SUCCESS, "%", "scenes",
        "{} reaches more goals than {} {where}",
        ((_GOALS, "static obstacles", "among static obstacles"),
         (_GOALS, "moving obstacles", "among moving obstacles")),
    ),
    (
        "Docking", SUCCESS, "%", "docks",
        "{} succeeds more often than {} {where}",
        ((_DOCKS, "free space", "in free space"), (_DOCKS, "wall or parking bay", "at a wall or in a bay"),
         (_DOCKS, "moving obstacles", "among moving obstacles")),
    ),
)  # fmt: skip


CROWDS = {  # the parts of equal inputs, as README calls them
    "in the open, lidar only": "for teams in the open",
    "at doors and in rooms, lidar only": "for teams at doors and in rooms",
    "on CrowdNav's test cases": "in crowds of 5 (CrowdNav)",
    "in AttnGraph's crowd": "in crowds of 20 (AttnGraph)",
    "among people who ignore the robot": "among people ignoring robots",
    "among people who avoid the robot": "among people avoiding robots",
}
TASKS = len(_TASKS) + 1
_SECTIONS = (
    "path-following-claims",
    "trajectory-tracking",
    "goal-obstacles-claims",
    "docking-claims",
)  # whose rows these are


def panels(store: Store) -> Iterator[Panel]:
    """Yields the tasks that there are kept rows of."""
    for title, axis, unit, scenes, win, kinds in _TASKS:
        matches_of = [
            _match(store.rows(f"{stem}_board"), store.rows(f"{stem}_pairs"), kind, where, unit)
            for stem, kind, where in kinds
        ]
        if matches := tuple(each for each in matches_of if each is not None):
            yield Panel(title, axis, unit, scenes, win, matches)
    if matches := tuple(_crowds(store)):
        win = "{} solves more scenes than {} {where}"
        yield Panel("Teams and crowds", "scenes solved (%)", "%", "scenes", win, matches)


def _match(board: Sequence[Row], lines: Sequence[Row], kind: str, where: str, unit: str) -> Match | None:
    """Returns the best controller without a map beside the best agent, in a kind of scenes."""
    able = [row for row in board if row["scenes"] == kind and row["inputs"] != ONLY_MAP]
    learned = [row for row in able if row["policy"] in LEARNED]
    held = at_pace(board, lines)
    agent = next(iter(best_sets(learned, held)), None)
    controller = next(iter(best_sets([row for row in able if row not in learned], held)), None)
    if agent is None or controller is None:
        return None
    verdict = verdict_of(lines, kind, entry_of(controller), entry_of(agent))
    if verdict is None:
        return None
    cost = next(name for name in agent if name.endswith(("(mm)", "time (s)")))
    column = SUCCESS if unit == "%" else cost
    names = (
        _controller(controller["policy"], controller["gains"]),
        _agent(agent["policy"], "" if agent["gains"] == "trained" else "one seed"),
    )
    bars = [Bar(each, *_numbers(row[column])) for each, row in zip(names, (controller, agent), strict=True)]
    here = Match(where, bars[0], bars[1], int(verdict[1]["scenarios"]), _outcome(*verdict, unit))
    both = controller, agent
    if unit == "%":
        ppo = next((row for row in learned if row["policy"] == PPO and row is not agent), None)
        if ppo is not None:
            beside = verdict_of(lines, kind, entry_of(controller), entry_of(ppo))
            less = beside is not None and beside[0].outcome == BETTER and beside[0].on_success
            said = f"; agent `{PPO}` {'succeeds less often:' if less else 'reaches'} {_numbers(ppo[SUCCESS])[0]:.1f} %"
            here = dataclasses.replace(here, ppo=said)
        collided = _numbers(controller["collision (%)"])[0], _numbers(agent["collision (%)"])[0]
        here = dataclasses.replace(here, collided=collided)
        if here.outcome in (BETTER, WORSE) and not verdict[0].on_success:
            turned = 1 if here.outcome == BETTER else -1
            alike = verdict[0].words.startswith(EQUIVALENT) or bars[0].value == bars[1].value == 100.0
            if not alike:  # no time makes up for successes that may differ
                return dataclasses.replace(here, outcome=OPEN, sooner=SIDES[::turned][0])
            times = [f"{_numbers(row[cost])[0]:.1f}" for row in both][::turned]
            return dataclasses.replace(here, faster="{} vs. {} s".format(*times))
        return here
    speeds, shares = ((_numbers(controller[each])[0], _numbers(agent[each])[0]) for each in ("speed (m/s)", SUCCESS))
    if "successes" in verdict[0].words:
        return dataclasses.replace(here, shares=shares)
    apart = abs(speeds[0] - speeds[1]) > PACE_TOLERANCE * speeds[1]
    return dataclasses.replace(here, speeds=speeds if apart else None)


def _controller(policy: str, gains: str) -> str:
    """Returns how a sentence calls a controller: default gains, the rule, go without saying."""
    return f"`{policy}`" + ("" if gains == "default" else f" ({gains})")


def _agent(policy: str, seeds: str) -> str:
    """Returns how a sentence calls an agent; where not all of several seeds drove, it says so."""
    return f"agent `{policy}`" + (f" ({seeds})" if seeds else "")


def _numbers(cell: str) -> tuple[float, float, float]:
    values = [float(each) for each in re.findall(r"-?\d+\.?\d*", cell)]
    return (values[0], values[1], values[2]) if len(values) == 3 else (values[0], values[0], values[0])


def _outcome(verdict: Verdict, line: Row, turned: bool, unit: str) -> str:
    """Returns the verdict of a pair; where nothing decides, what its interval of success, or of error, says alone."""
    words = verdict.words
    if verdict.outcome in (BETTER, WORSE):
        return verdict.outcome
    of = "success" if unit == "%" or "successes" in words else "error"
    low, high = (
        float(line[name] or "nan") for name in (("from", "to") if of == "success" else ("cost from", "cost to"))
    )
    if turned != (of == "error"):  # less of an error is better
        low, high = -high, -low
    if verdict.outcome == SLOWER:  # an error at another speed, which is told beside it
        return OPEN
    words_of = EQUIVALENT if words == EQUIVALENT or f"{EQUIVALENT} in {of}" in words else OPEN
    return flocks.leaning(words_of, low, high).partition(", ")[0]


def _crowds(store: Store) -> Iterator[Match]:
    """Yields the agents among others beside the best controllers of equal access."""
    teams, people = (part_rows.read(store.home / RESULTS / flocks.FILES[part]) for part in ("teams", "people"))
    if not teams or not people:
        return
    of_page = flocks.of_page(teams, people)
    for where, agents, laws, metric, rows in flocks.front_parts(teams, people):
        if where not in CROWDS:
            continue
        agent, law, here = flocks.rival(rows, agents, laws, metric)
        less, later = (flocks.less(here, agent, law, *of) for of in ((metric,), ("extra_time", metric)))
        verdict = less.outcome(of_page).partition(", ")[0]
        outcome = {BETTER: WORSE, WORSE: BETTER, AHEAD: BEHIND, BEHIND: AHEAD}.get(verdict, verdict)
        faster = sooner = ""
        alike = outcome == EQUIVALENT or all(_share(here, of, metric)[0] == 100.0 for of in (law, agent))
        if outcome in (OPEN, EQUIVALENT) and (pace := later.pace(of_page)):
            if not alike:
                sooner = SIDES[pace == "faster"]
            else:
                outcome, faster = WORSE if pace == "faster" else BETTER, f"{abs(later.value):.1f} s sooner"
        gains = "tuned" if law.endswith(flocks.TUNED) else "default"
        names = _controller(law.removesuffix(flocks.TUNED), gains), _agent(agent, _seeds(here, agent))
        bars = [Bar(name, *_share(here, of, metric)) for name, of in zip(names, (law, agent), strict=True)]
        collided = tuple(_numbers(flocks.collisions(here, each).partition(" ")[0])[0] for each in (law, agent))
        shown = Match(CROWDS[where], bars[0], bars[1], less.worlds, outcome, faster=faster, sooner=sooner)
        yield dataclasses.replace(shown, collided=(collided[0], collided[1]))


def _seeds(rows: Sequence[Row], agent: str) -> str:
    """Returns how many seeds of an agent drove, of those that ship; "" where all did."""
    drove, all_of_them = flocks.seeds_of(rows, agent), len(list(shipped(flocks.AGENTS[agent], flocks.ROBOT)))
    return "" if drove == all_of_them else f"{drove} seeds"


def _share(rows: Sequence[Row], name: str, metric: str) -> tuple[float, float, float]:
    """Returns a share of worlds in per cent with its interval, over the worlds and the seeds of an agent."""
    worlds = flocks.by_world(rows, name, metric)
    table = 100.0 * np.array(list(worlds.values()))
    ends = interval(table, ["/".join(key[:2]) for key in worlds], mean)
    value = float(table.mean())
    return value, *(ends or (value, value))


def sentences(shown_panels: Sequence[Panel]) -> list[str]:
    """Returns a sentence a task, of its first kind of scenes: who wins, by how much, in how many scenes."""
    return [f"- **{panel.title}**: {_sentence(panel, panel.matches[0])}." for panel in shown_panels]


def _sentence(panel: Panel, match: Match) -> str:
    """Returns the words of an outcome in a kind of scenes, with the numbers."""
    a, b = match.controller, match.agent
    turned = -1 if match.outcome in (WORSE, BEHIND) else 1  # the better one is named first
    names, values, speeds = (a.name, b.name)[::turned], (match.shares or (a.value, b.value))[::turned], match.speeds
    unit, win = (panel.unit, panel.win) if match.shares is None else ("%", "{} succeeds more often than {} {where}")
    if match.faster:
        win = "{} is faster than {} {where}"
    digits, of = (1, "success rate") if unit == "%" else (2, "error")
    numbers = f"{'RMS ' * (unit == 'mm')}{values[0]:.{digits}f} vs. {values[1]:.{digits}f} {unit}"
    if match.faster and a.value == b.value:
        numbers = f"{values[0]:.{digits}f} %"
    if match.collided and any(match.collided):
        numbers += ", collisions {:.1f} vs. {:.1f} %".format(*match.collided[::turned])
    numbers += f", {match.scenes:,} {panel.scenes}"
    if match.faster:  # elsewhere the numbers are those of the verdict
        numbers = f"{match.faster}; {'both ' * (a.value == b.value)}{numbers}"
    if speeds:
        numbers += ", at {:.2f} vs. {:.2f} m/s".format(*speeds[::turned])
    words = {
        EQUIVALENT: f"{{}} and {{}} are equivalent in {of} {{where}}",
        **dict.fromkeys((AHEAD, BEHIND), "{} is ahead of {}, but not significantly, {where}"),
        OPEN: "neither {} nor {} is significantly better {where}",
    }.get(match.outcome, win)
    where = f"on {match.where}" if panel.unit == "mm" and words != panel.win else match.where
    return f"{words.format(*names, where=where)} ({numbers}){match.ppo}"


def readme(store: Store) -> dict[str, bytes]:
    """Returns README.md with its part made anew, by its place; ValueError if it has lost its markers."""
    stale = [made.sentence() for section, made in store.sections() if section.name in _SECTIONS and made.stale]
    return {README: marked(store, README, [*_lines(list(panels(store))), *stale]).encode()}


def _lines(shown_panels: Sequence[Panel]) -> list[str]:
    if not shown_panels:
        return ["No run of this version is published."]
    shown = f"![Best controller and agent at each task, with 95 % intervals]({FIGURE})"
    first = "Examples ([all results](docs/results.md)):"
    return ["\n".join([_count(shown_panels), "", shown, "", first, "", *sentences(shown_panels)])]


def _count(shown_panels: Sequence[Panel]) -> str:
    """Returns how many kinds of scenes each camp wins, and which."""
    won, lost = (
        [_where(panel, match) for panel in shown_panels for match in panel.matches if match.outcome == outcome]
        for outcome in (BETTER, WORSE)
    )
    matches = [match for panel in shown_panels for match in panel.matches]
    outcomes = [match.outcome for match in matches]
    wins, losses = (str(len(each) or "none") for each in (won, lost))
    alike = outcomes.count(EQUIVALENT)
    ties = len(outcomes) - len(won) - len(lost) - alike
    quick = [f"{each.where} the {each.sooner}" for each in matches if each.sooner]
    quick[:1] = [f"{each} is faster" for each in quick[:1]]
    noted = f" ({', '.join(quick)}, but equal success is unproven)" if quick else ""
    which = [
        f"{camp} win {_listed(each).replace(', on ', ', ')}. "
        for camp, each in (("Controllers", won), ("Agents", lost))
        if each
    ]
    return (
        f"**Controllers win {wins} of {len(outcomes)} kinds of scenes, agents {losses}.** "
        + "".join(which)
        + f"In {alike} other{'s' * (alike != 1)}, both are equivalent (success within 1 point, time and error within "
        f"5 %). In {ties}, neither is significantly better in success or error after multiple-test "
        f"correction{noted}."
    )


def _listed(phrases: Sequence[str]) -> str:
    return phrases[0] if len(phrases) == 1 else f"{', '.join(phrases[:-1])} and {phrases[-1]}"


def _where(panel: Panel, match: Match) -> str:
    """Returns a kind of scenes as a phrase."""
    task = f"{'when' if panel.title == 'Docking' else 'in'} {panel.title.lower()} "
    task = "" if match.where in CROWDS.values() else task
    place = match.where.partition(" (")[0]  # whose crowd it is stands in the figure
    return f"{'on ' if panel.unit == 'mm' else task}{place}{' (equal success: time decides)' * bool(match.faster)}"


def figure(shown_panels: Sequence[Panel]) -> bytes:
    """Returns the figure as PNG: a panel a task, a group of two bars a kind of scenes."""
    with matplotlib.rc_context(RC):
        drawn = Figure((9.6, 10.2))
        for axes, panel in zip(drawn.subplots(2, 2, height_ratios=(3, 5)).flat, shown_panels, strict=False):
            _draw(axes, panel)
        marks = "bold: wins; \u2248: equivalent; whiskers: 95 %"
        keys = {"best controller": CONTROLLER, "best trained agent": AGENT, marks: "none"}
        handles = [Patch(color=of, label=label) for label, of in keys.items()]
        drawn.legend(handles=handles, loc="lower center", ncols=3, fontsize=14, columnspacing=0.8, handlelength=1.5)
        drawn.tight_layout(rect=(0.0, 0.05, 1.0, 1.0), h_pad=2.0, w_pad=3.0)
        file = io.BytesIO()
        drawn.savefig(file, format="png", dpi=100)
    return file.getvalue()


def _draw(axes: Any, panel: Panel) -> None:
    ends, digits = max(max(m.controller.high, m.agent.high) for m in panel.matches), 1 if panel.unit == "%" else 2
    for k, match in enumerate(panel.matches):
        # where times decide they stand behind the values, the better one's first
        times = re.findall(r"[\d.]+(?= vs| s$)", match.faster)[:: -1 if match.outcome == WORSE else 1]
        wins = {BETTER: 0, WORSE: 1}.get(match.outcome)
        for side, (bar, colour) in enumerate(((match.controller, CONTROLLER), (match.agent, AGENT))):
            y = k - 0.18 + 0.36 * side
            reach = [[max(bar.value - bar.low, 0.0)], [max(bar.high - bar.value, 0.0)]]
            axes.barh(y, bar.value, 0.34, color=colour, xerr=reach, error_kw={"capsize": 3, "lw": 1.5})
            name, value = re.sub(r"`|^agent | \(.*\)", "", bar.name), f"{bar.value:.{digits}f}"
            inside = bar.value > 0.6 * ends
            if inside:
                dark = colour == CONTROLLER
                size = 14 if len(name) < 15 else 12  # clear of the interval
                axes.text(0.02 * ends, y, name, va="center", fontsize=size, color="white" if dark else "black")
            value += f", {times[side]} s" if len(times) == 2 else " \u2248" * (match.outcome == EQUIVALENT)
            text = value if inside else f"{name} {value}"
            weight = "bold" if side == wins else "normal"
            axes.text(bar.high + 0.03 * ends, y, text, va="center", fontsize=14, fontweight=weight)
    axes.set_yticks(
        range(len(panel.matches)), list(map(_wrapped, panel.matches)), fontsize=14 if len(panel.matches) < 5 else 11
    )
    axes.invert_yaxis()
    axes.set_xlim(0.0, ends * (1.3 if any(match.faster for match in panel.matches) else 1.2))
    if panel.unit == "%":
        axes.set_xticks(range(0, 101, 25))
    axes.tick_params(axis="x", labelsize=13)
    axes.set_xlabel(panel.axis, fontsize=13)
    axes.set_title(panel.title, fontsize=16, loc="left", x=-0.5, fontweight="bold")
    axes.grid(visible=False, axis="y")


def _wrapped(match: Match) -> str:
    words = re.sub("^(for|in|among) (?=teams|crowds|people)", "", match.where).split()
    halves = [(" ".join(words[:k]), " ".join(words[k:])) for k in range(1, len(words))]
    return "\n".join((*min(halves, key=lambda lines: max(map(len, lines))), f"n = {match.scenes:,}"))


def film(store: Store) -> bytes:
    """Returns an animated WebP: VFH+ and PPO's median seed drive the same moving obstacles, side by side."""
    seeds = [row for row in store.rows("claims/goal_obstacles_p3dx_seeds") if row["policy"] == "ppo"]
    seeds.sort(key=lambda row: float(row["success (%)"]))
    median = int(seeds[len(seeds) // 2]["seed"])
    sides = {
        "VFH+ (controller)": policies.make("vfh_plus", **policies.tuned_gains("vfh_plus", "goal-obstacles")),
        "PPO (trained agent)": policies.make("ppo", seed=median),
    }
    for scene in itertools.count():  # the first that both finish, as either does in nineteen of twenty
        reels = [_reel(policy, name, scene) for name, policy in sides.items()]
        if all(reels):
            break
    frames = []
    for k in range(max(map(len, reels)) + 5):  # the end stands still for a moment
        both = [reel[min(k, len(reel) - 1)] for reel in reels]
        sheet = Image.new("RGB", (2 * FRAME_PX + 8, both[0].height), "white")
        for place, image in enumerate(both):
            sheet.paste(image, (place * (FRAME_PX + 8), 0))
        frames.append(sheet)
    file = io.BytesIO()
    period = round(1e3 * CONTROL_PERIOD * FRAME_SKIP / PACE_SHOWN)
    frames[0].save(file, "WEBP", save_all=True, append_images=frames[1:], duration=period, loop=0, quality=60, method=6)
    return file.getvalue()


def _reel(policy: Any, name: str, scene: int) -> list[Any]:
    """Returns the frames of an episode, each with the policy's name, the last with its time; none of a failure."""
    env: Any = gymnasium.make(
        "wayfield/DiffDriveGoalObstacles-v0", scenario=FILMED, actuators="lagged", num_beams=72, max_range=5.0,
        render_mode="rgb_array",
    )  # fmt: skip
    pilot = policies.Pilot(policy, env)
    observation, _ = env.reset(seed=0, options={"scenario": scene})
    pilot.reset()
    frames, step, ended = [], 0, False
    while not ended:
        observation, _, terminated, truncated, info = env.step(pilot.act(observation))
        ended = terminated or truncated
        if step % FRAME_SKIP == 0 or ended:
            image = Image.fromarray(env.render())
            image = image.resize((FRAME_PX, FRAME_PX * image.height // image.width), Image.Resampling.LANCZOS)
            pen = ImageDraw.Draw(image)
            pen.rectangle((0, 0, FRAME_PX, 24), fill="white")  # over the renderer's own line, too small here
            caption = f"{name}: goal after {info['time']:.1f} s" if ended else name
            pen.text((6, 2), caption, fill="black", font_size=18)
            frames.append(image)
        step += 1
    env.close()
    return frames if info["success"] else []
