"""One description of a result in three dimensions: bodies with their sizes and poses over time."""
