"""Laws that drive among other bodies."""
