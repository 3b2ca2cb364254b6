"""How the authors' loops are written, after methods.md 3 and 8: one seed, eager, the data on the host.

They are references to time against and nobody's source: where methods.md is silent about a cost, there is none here.
"""
