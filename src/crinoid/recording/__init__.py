"""Reading files: a CSV or netCDF file becomes a current, a motion or a path.

Nothing here knows how they are evaluated; a file that does not fit is a `ScenarioError`.
"""

from crinoid.recording.named import series_readers as series_readers
from crinoid.recording.recording import Recording as Recording
from crinoid.recording.recording import read_recording as read_recording
from crinoid.recording.series import Series as Series
from crinoid.recording.stage import Stage as Stage
