"""Laws that follow a reference in time."""
