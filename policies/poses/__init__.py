"""Laws that drive to a pose or a goal, by what is known of the map."""
