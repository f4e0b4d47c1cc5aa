"""What stands in the plane: points, paths, obstacles, grids, moving obstacles."""
