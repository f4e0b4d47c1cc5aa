"""What a run leaves: cases, trajectories, episodes with their columns, and the folder that holds them."""
