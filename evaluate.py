"""Compares the classical controllers with the published figures, and with one another: python evaluate.py --help"""

import os
import signal
import sys


def _interrupted(number: int, _: object) -> None:
    os.write(2, b"evaluate: interrupted; nothing was written\n")
    os._exit(128 + number)  # half-imported modules may turn an exception into anything


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupted)

try:
    from wayfield.benchmarks.commands.evaluate import main
except ModuleNotFoundError as error:
    sys.exit(f'evaluate: {error.name} is missing; pip install -c constraints.txt -e ".[all]"')

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    main()
