"""What laws share: scans and stopping, detours, points and speeds of paths, tracking, grids and their search."""
