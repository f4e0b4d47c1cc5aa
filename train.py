"""Trains agents by reinforcement: python train.py --help"""

import os
import signal
import sys


def _interrupted(number: int, _: object) -> None:
    os.write(2, b"train: interrupted; nothing was written\n")
    os._exit(128 + number)  # half-imported modules may turn an exception into anything


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupted)

# threads that wait must not spin: beside other work a spinning thread makes an update twenty times slower
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

try:
    from wayfield.policies.training.command import main
except ModuleNotFoundError as error:
    sys.exit(f'train: {error.name} is missing; pip install -c constraints.txt -e ".[train]"')

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    main()
