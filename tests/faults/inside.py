"""The process of trials that may crash or not end: answers each line of JSON with one; started by `place.Inside`."""

import importlib
import json
import os
import resource
import signal
import sys
import traceback

_CPU = 100.0  # s of computing without a sign of life after which a trial hangs; some of it compiles
_MEMORY = 12 << 30  # bytes of addresses; libraries and compiled code take a third of it


def alive() -> None:
    """Gives a trial of many small steps the time of a single one again."""
    signal.setitimer(signal.ITIMER_PROF, _CPU)  # its signal ends the process, in compiled code too


def main() -> None:
    """Answers until the input ends."""
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with os.fdopen(os.dup(1), "w") as answers:
        os.dup2(2, 1)  # what is printed goes to the log
        for line in sys.stdin:
            group, spec = json.loads(line)
            alive()
            try:
                answer = importlib.import_module(group).inside(spec)
            except BaseException as error:  # whatever a trial did not expect is what is looked for
                traceback.print_exc()
                answer = {"problem": f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"}
            answers.write(json.dumps(answer) + "\n")
            answers.flush()


if __name__ == "__main__":
    main()
