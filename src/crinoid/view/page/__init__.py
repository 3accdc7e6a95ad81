"""HTML pages of runs and studies: an animation, charts and tables in one file."""
