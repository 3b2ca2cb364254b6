"""Data files that others made: D4RL's HDF5, Minari's datasets, robomimic's HDF5, behind one interface."""
