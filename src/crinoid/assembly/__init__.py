"""Assembly: from a scenario to numbers, arrays, `System`, controller and sensors.

May import ``recording`` and lower folders.
"""
