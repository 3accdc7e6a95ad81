"""Charts of a run as data: chosen, computed and named once, for paper and for the page."""
