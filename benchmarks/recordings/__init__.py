"""Episodes as data sets: Minari and MCAP."""
