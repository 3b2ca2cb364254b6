"""Trajectories, boundary rules, recipes, the generated source and the firewall."""
