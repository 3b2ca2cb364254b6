"""One cell: sample, update, checkpoint, evaluate, record."""
