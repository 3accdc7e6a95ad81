"""Tables of a scenario that go together."""

AT_REST = ("arm", "base", "water", "flow", "load", "tool", "chamber", "tendon", "obstacle")
"""Tables that an equilibrium depends on."""
