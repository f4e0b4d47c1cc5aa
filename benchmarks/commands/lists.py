"""What there is: `wayfield policies`, `wayfield scenarios`, `wayfield robots`."""

import shutil
from collections.abc import Mapping, Sequence

import click
import rich.box
import rich.console
import rich.table

from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.scenarios import GOAL_SCENARIOS, PATH_SCENARIOS, SPLITS, TIERS
from wayfield.envs.tasks.specs import EVERY, TaskSpec
from wayfield.system.checks import choose
from wayfield.system.command_line import OneLineErrors


def _chosen(what: str, words: Sequence[str], known: Mapping[str, str]) -> list[str]:
    """Returns the names that the words are, or are a part of, in the order of the list, or all; else ends in a line.

    Args:
        what: what a name is of.
        words: as they were typed.
        known: the task or drive of each name, which a word may be as well.
    """
    chosen = set() if words else set(known)
    for word in words:
        hits = {word} & known.keys() or {name for name, more in known.items() if word in name or word in more.split()}
        if not hits:
            try:
                choose(what, word, known)
            except ValueError as error:
                raise click.UsageError(str(error)) from None
        chosen |= hits
    return [name for name in known if name in chosen]


def _task(spec: TaskSpec) -> str:
    """Returns the words by which a task may be named: its kind and its suite."""
    return f"{spec.kind} {spec.suite}"


@click.command("policies", cls=OneLineErrors)
@click.argument("names", nargs=-1)
def policies(names: tuple[str, ...]) -> None:
    """Lists the policies, or those that NAMES name, also by a part or the task: inputs, needs, control law, source."""
    from wayfield.benchmarks.leaderboards.disclosure import inputs
    from wayfield.policies import ABOUT, drives

    rows = []
    driven = {name: [spec for spec in EVERY.values() if drives(name, spec)] for name in ABOUT}
    for name in _chosen("policy", names, {name: " ".join(map(_task, driven[name])) for name in ABOUT}):
        about = ABOUT[name]
        policy = about.make()
        needs = ", ".join(getattr(policy, "needs", ())) or "-"
        rows.append(
            [
                name,
                "\n".join(spec.kind for spec in driven[name]),
                "\n".join(inputs(policy.knows, spec.observes) for spec in driven[name]),
                needs,
                about.what + (f" ({about.source})" if about.source else ""),
            ]
        )
    _show("Policies", ("name", "task", "inputs", "needs", "what it is"), rows)
    _say(
        "Inputs: what a policy gets before an episode, or while it drives: path errors, a lidar, the nearest bodies. "
        "Needs: what a robot must be. "
        "wayfield.policies.make(NAME) makes one; help() of it has its gains, its equations and its whole source. "
        "All get the robot's pose."
    )


@click.command("scenarios", cls=OneLineErrors)
@click.argument("names", metavar="[FAMILIES]...", nargs=-1)
def scenarios(names: tuple[str, ...]) -> None:
    """Lists the families of scenarios of each task, or those that FAMILIES name, also by a part or the task."""
    from wayfield.envs.scenarios import splits

    chosen = _chosen("family", names, {each: _task(spec) for spec in EVERY.values() for each in spec.families})
    for spec in EVERY.values():
        rows = []
        for family in (each for each in spec.families if each in chosen):
            tiers = [tier for name in SPLITS for tier in splits.tiers(spec.name, family, name)]
            there = ", ".join(tier for tier in TIERS if tier in tiers) or "not frozen"
            rows.append([family, there, spec.families[family].about])
        if rows:
            _show(f"{spec.title}: {', '.join(spec.ids.values())}", ("family", "tiers", "what it is"), rows)
    sizes = ", ".join(f"{name} ({count})" for name, count in SPLITS.items())
    _say(
        f"Frozen splits, scenarios a family: {sizes}. scenario=NAME draws from the training split, NAME/test from the "
        "test split, all/test from all families; all_1/test from version 1 of that list."
    )
    _say(f"Courses of the reference papers and other lists, paths: {', '.join(PATH_SCENARIOS)}.")
    _say(f"Goals: {', '.join(GOAL_SCENARIOS)}. Your own file: its path.")


@click.command("robots", cls=OneLineErrors)
@click.argument("names", nargs=-1)
def robots(names: tuple[str, ...]) -> None:
    """Lists the robots, or those that NAMES name, also by a part or the drive: size, mass, limits, environments."""
    rows = []
    for name in _chosen("robot", names, {name: robot.drive for name, robot in ROBOTS.items()}):
        robot = ROBOTS[name]
        ids = "\n".join(spec.env_id(robot).removeprefix("wayfield/") for spec in EVERY.values())
        rows.append([name, _drive(robot), f"{hull_words(robot)}\n{robot.mass:g} kg", _limits(robot), ids])
    _show("Robots", ("name", "drive", "hull, mass", "at most", "wayfield/"), rows)
    _say(
        "Hull: radius of a disc, or sides of a rectangle. At most: each axis alone, in the tiers lagged and slow; the "
        "last line is the wheel speed."
    )


def hull_words(robot: Robot) -> str:
    """Returns the size of a hull, in words."""
    if robot.hull_box is None:
        return f"{robot.hull_radius:.3g} m"
    return f"{robot.hull_box[0]:.3g} m x {robot.hull_box[1]:.3g} m"


def _drive(robot: Robot) -> str:
    radii = sorted({round(1000.0 * radius) for radius in robot.wheel_radii.tolist()})
    return f"{robot.drive}\n{len(robot.wheels)} wheels,\nr {', '.join(map(str, radii))} mm"


def _limits(robot: Robot) -> str:
    units = ("m/s ahead", "m/s aside", "rad/s")
    most = [f"{robot.max_twist[k]:.2f} {units[axis]}" for k, axis in enumerate(robot.twist_axes)]
    return "\n".join([*most, f"{robot.rated_wheel_speed:.1f} rad/s"])


def console() -> rich.console.Console:
    """Returns a console as wide as COLUMNS or the terminal says, or 80 characters where neither does."""
    return rich.console.Console(width=shutil.get_terminal_size().columns)


def _show(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    page = console()
    table = rich.table.Table(
        title=title, title_justify="left", box=rich.box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True
    )
    for name in header:
        # names are for copying: they are never broken
        table.add_column(
            name, no_wrap=name in (header[0], "task", "access", "drive", "at most", "wayfield/"), overflow="fold"
        )
    for row in rows:
        table.add_row(*row)
    with page.capture() as capture:
        page.print(table)
    for line in capture.get().splitlines():
        print(line.rstrip())


def _say(text: str) -> None:
    console().print(text, markup=False, highlight=False)
    print()
