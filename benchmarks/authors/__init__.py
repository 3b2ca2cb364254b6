"""Reference loops in the manner of the authors' code: one seed, eager, data on the host.

Written for timing, not copied from any source; costs that are not known are left out.
"""
