"""A load, a current, a sensor, an actuator and a controller for crinoid."""
