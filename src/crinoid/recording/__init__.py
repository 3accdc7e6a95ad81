"""Readers of files: measured time series as currents, motions and paths; solids.

May import ``scenario`` and lower folders.

Nothing here knows how they are evaluated; a file that does not fit is a `ScenarioError`.
"""

from crinoid.recording.elevation import at_gauge as at_gauge
from crinoid.recording.proposal import propose as propose
from crinoid.recording.readers import read_dataset as read_dataset
from crinoid.recording.recording import Recording as Recording
from crinoid.recording.recording import read_recording as read_recording
from crinoid.recording.response import VesselResponse as VesselResponse
from crinoid.recording.sea import Sea as Sea
from crinoid.recording.seas import read_sea as read_sea
from crinoid.recording.series import Series as Series
from crinoid.recording.series import series_readers as series_readers
from crinoid.recording.solid_surface import SolidSurface as SolidSurface
from crinoid.recording.surfaces import surface_readers as surface_readers
