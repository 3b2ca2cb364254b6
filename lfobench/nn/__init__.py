"""Building blocks for methods: networks with a seed axis, policies, optimisers, and ordinary modules per seed."""
