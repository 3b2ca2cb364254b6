"""One table model, many exporters.

``building`` turns records into a ``table.Table``; each exporter is a pure function of that model; ``formats``
lists the textual ones by name, and ``terminal`` draws on a console.
"""
