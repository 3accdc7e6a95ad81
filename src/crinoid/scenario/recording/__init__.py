"""Reading measured currents: a netCDF file becomes a velocity over time and height.

Nothing here knows how a current is evaluated; a file that does not fit is a `ScenarioError`.
"""

from crinoid.scenario.recording.recording import Recording as Recording
from crinoid.scenario.recording.recording import read_recording as read_recording
from crinoid.scenario.recording.stage import Stage as Stage
