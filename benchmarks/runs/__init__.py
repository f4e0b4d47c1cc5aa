"""How a contest is driven: its cases in shards, over threads, processes or machines."""
