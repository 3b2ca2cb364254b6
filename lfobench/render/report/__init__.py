"""One page that says what the records show: verdict, table, curves, provenance, commands."""
