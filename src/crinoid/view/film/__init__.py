"""Films of a run: the same data as on the page, frame by frame, as MP4 or GIF."""
