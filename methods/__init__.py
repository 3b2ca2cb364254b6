"""The methods that the benchmark compares: one method, one file; networks and actors shared beside them."""
