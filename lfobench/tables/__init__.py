"""Tables of records: one model, built from records, with the footnote that explains it."""
