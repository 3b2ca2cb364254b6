"""Pictures of a table seen from above: paths, fields of actions, hits and films."""
