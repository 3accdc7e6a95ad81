"""Policies trained in simulation, by imitation and by gradients through the closed loop.

May import ``view`` and lower folders.
"""
