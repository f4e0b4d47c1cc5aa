"""Laws that drive to a goal by what the scan shows, and the map that they make of it."""
