"""Compares the classical controllers with the published figures, and with one another: python evaluate.py --help"""

import sys

WAYFIELD_COMMAND = "evaluate"  # whose name an interruption while it is imported says

try:
    from wayfield.benchmarks.commands.evaluate import main
except ModuleNotFoundError as error:
    sys.exit(f'evaluate: {error.name} is missing; pip install -c constraints.txt -e ".[all]"')

if __name__ == "__main__":
    main()
