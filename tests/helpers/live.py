"""A scenario of sessions that pages show."""

from crinoid.scenario import Scenario

LIVE = Scenario.from_toml("""
arm = {nodes=4}
base = {channels={slide={}}}
flow = [{kind="sine", amplitude=[0.3, 0.0], frequency_hz=0.5}]
obstacle = [{kind="sphere", position=[0.3, -9.5], radius=0.05}]
control = {kind="pid", controlled=["x"], mapping="identity", pid={slide={kp=0.2}}}
""")
