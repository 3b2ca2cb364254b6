"""How the authors' loops are written, one seed, eager, the data on the host.

They are references to time against and nobody's source: where nothing is known of a cost, there is none here.
"""
