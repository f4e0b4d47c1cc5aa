"""Trains agents by reinforcement: python train.py --help"""

import os
import sys

WAYFIELD_COMMAND = "train"  # whose name an interruption while it is imported says

# threads that wait must not spin: beside other work a spinning thread makes an update twenty times slower
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

try:
    from wayfield.policies.training.command import main
except ModuleNotFoundError as error:
    sys.exit(f'train: {error.name} is missing; pip install -c constraints.txt -e ".[train]"')

if __name__ == "__main__":
    main()
