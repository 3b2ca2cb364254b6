"""The built-in suites: one file per suite; environments and demonstrators in packages below."""
