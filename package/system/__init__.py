"""The lowest floor: compiled code, threads and processes, files and their checks. Knows no robot and no world."""
