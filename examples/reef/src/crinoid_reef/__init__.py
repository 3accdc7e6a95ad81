"""A load, a current, a sensor, an actuator, a controller and a reader for crinoid."""
