"""Compares the classical controllers with the published figures, and with one another: python evaluate.py --help"""

from wayfield.benchmarks.evaluate import main

if __name__ == "__main__":
    main()
