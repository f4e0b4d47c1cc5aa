"""`wayfield compile`: machine code of the kernels, made before it is needed, for this machine or for others.

It drives each environment and each policy for a few steps, in processes of their own: what they compile is kept where
they keep it. It needs no extra.
"""

import argparse
import contextlib
import os
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

import gymnasium

from wayfield.envs.tasks.specs import CROWDS, EVERY, TASKS
from wayfield.policies import ABOUT, Pilot, make
from wayfield.starting import started
from wayfield.system.checks import choose, printable, suggestion
from wayfield.system.compile_notices import NO_CACHE
from wayfield.system.executors import cores, say, workers
from wayfield.system.processor_level import levels, settings_of

_STEPS = 3
_INTERRUPTED = 130


class _Parser(argparse.ArgumentParser):
    """A parser that ends in one line where the words are wrong."""

    def error(self, message: str) -> NoReturn:
        """Exits with status 2."""
        self.exit(2, f"{self.prog}: {printable(message)}\n")


def compile(args: Sequence[str], prog_name: str) -> None:
    """Compiles what the words say, and exits."""
    parser = _Parser(prog=prog_name, description="Compiles the kernels of all environments and policies.")
    parser.add_argument(
        "--level",
        action="append",
        metavar="|".join(levels()) or "LEVEL",
        help="for processors of this instruction set level or higher, repeatable; default: the level of this one",
    )
    parser.add_argument("--into", type=Path, metavar="FOLDER", help="write them there: then set NUMBA_CACHE_DIR to it")
    parser.add_argument("--only", metavar="NAME", help="one environment or policy; else all")
    words, unknown = parser.parse_known_args(args)
    if unknown:
        parser.error(f"{unknown[0]!r} is no option.{suggestion(unknown[0], parser._option_string_actions)}")
    started()
    mine = () if "NUMBA_CPU_NAME" in os.environ else levels()[:1]  # named, or lower ones that are there would do
    chosen = words.level or mine or (None,)
    items = [*EVERY, *ABOUT]
    try:
        for level in words.level or ():
            choose("--level", level, levels())
        if words.only is not None:
            choose("--only", words.only, items)
            items = [words.only]
        if words.into is not None:
            words.into.mkdir(parents=True, exist_ok=True)
    except ValueError as error:
        parser.error(str(error))
    except OSError as error:
        parser.exit(1, f"{prog_name}: --into {error}\n")
    try:
        for level in chosen:
            with _settings(level, words.into), workers(max(cores(), 2)) as executor:
                folders = set()
                for item, folder in zip(items, executor(driven, items), strict=True):
                    folders.add(folder)
                    say(f"{level or 'this machine'}: {item} is compiled")
                print(f"kept in {os.environ.get('NUMBA_CACHE_DIR') or ', '.join(sorted(folders))}")
    except KeyboardInterrupt:
        parser.exit(_INTERRUPTED, f"{prog_name}: interrupted; what was compiled is kept\n")
    except (OSError, RuntimeError, RuntimeWarning) as error:
        parser.exit(1, f"{prog_name}: {printable(str(error))}\n")


@contextlib.contextmanager
def _settings(level: str | None, into: Path | None) -> Iterator[None]:
    """Makes processes that are started within compile for a level, and keep it in a folder."""
    before = dict(os.environ)
    os.environ.pop(NO_CACHE, None)  # here it is an error, whoever has said it before
    os.environ.update({} if level is None else settings_of(level))
    os.environ.update({} if into is None else {"NUMBA_CACHE_DIR": str(into.absolute())})
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def driven(name: str) -> str:
    """Returns the folder that holds the kernels of an environment's task or a policy, by its name, once it has driven.

    Raises:
        RuntimeWarning: if they cannot be kept.
        RuntimeError: if they cannot run here.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", "wayfield compiles", RuntimeWarning)
        if name in EVERY:
            _drive_task(name)
        else:
            _drive_policy(name)
        from wayfield.system.elementary import sin_cos

        sin_cos(0.5)
        return str(sin_cos.stats.cache_path)


def _drive_task(name: str) -> None:
    spec = EVERY[name]
    plants: tuple[dict[str, Any], ...] = () if name in CROWDS else ({"dynamics": "pymunk"},)
    for env_id in spec.ids.values():
        for options in ({}, {"scenario": "all"}, *plants):
            env = gymnasium.make(env_id, disable_env_checker=True, **options)
            env.reset(seed=0)
            for _ in range(_STEPS):
                env.step(env.action_space.sample())
            env.close()


def _drive_policy(name: str) -> None:
    for spec in EVERY.values():
        for env_id in spec.ids.values():
            envs: list[Any] = [gymnasium.make(env_id, disable_env_checker=True)]
            if spec in TASKS.values():
                envs.append(gymnasium.make_vec(env_id, 2, vectorization_mode="vector_entry_point"))
            for env in envs:
                with contextlib.suppress(TypeError, ValueError):  # it drives other robots, or other tasks
                    pilot = Pilot(make(name), env)
                    observation, _ = env.reset(seed=0)
                    pilot.reset()
                    for _ in range(_STEPS):
                        observation, *_ = env.step(pilot.act(observation))
                env.close()
