"""The page of a run: one HTML file that shows it move, beside its charts and tables."""
