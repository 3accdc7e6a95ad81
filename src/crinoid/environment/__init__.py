"""The closed loop as environments of Gymnasium; importing this registers their ids."""

from crinoid.environment.tasks import register_tasks

register_tasks()
