"""The child of `Server`: reads trials as lines of JSON, answers each with a line; dots while it compiles or steps."""

import importlib
import json
import os
import resource
import sys
import threading
import time
import traceback

from numba.core import event

from wayfield.benchmarks.faults import life
from wayfield.envs.processes import end_with_parent


class _Compiling(event.Listener):
    """Counts what is being compiled."""

    depth = 0

    def on_start(self, event: event.Event) -> None:
        self.depth += 1

    def on_end(self, event: event.Event) -> None:
        self.depth -= 1


def main() -> None:
    """Answers until the input ends."""
    end_with_parent(int(sys.argv[1]))
    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]),) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.dup(1)
    os.dup2(2, 1)  # what is printed goes to the log
    compiling = _Compiling()
    event.register("numba:compile", compiling)  # type: ignore[no-untyped-call]

    def live() -> None:
        told = 0
        while True:
            time.sleep(1.0)
            if compiling.depth or life.signs != told:
                told = life.signs
                os.write(answers, b".")

    threading.Thread(target=live, daemon=True).start()
    for line in sys.stdin:
        module, spec = json.loads(line)
        try:
            answer = importlib.import_module(f"wayfield.benchmarks.faults.{module}").inside(spec)
        except BaseException as error:  # whatever a trial did not expect is what is looked for
            traceback.print_exc()
            answer = {"problem": f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"}
        os.write(answers, json.dumps(answer).encode() + b"\n")


if __name__ == "__main__":
    main()
