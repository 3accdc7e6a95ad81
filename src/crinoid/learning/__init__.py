"""Policies trained in simulation: imitation, gradients through the closed loop, and PPO."""
