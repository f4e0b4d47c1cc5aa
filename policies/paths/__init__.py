"""Laws that drive along a path."""
