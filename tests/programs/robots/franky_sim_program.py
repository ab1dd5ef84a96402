"""Serves one arm of franky-sim, in that package's own environment: ADDRESS SLOWNESS [MASS].

It has no limits and no reflexes. SLOWNESS: how many milliseconds one of its robot's takes. MASS: kg of the hand that
its gravity compensation knows of, where that is not the one that it carries.
"""

import sys

import franky_sim
from franky_sim.mujoco_simulator import MujocoSimulator

address, slowness = sys.argv[1], float(sys.argv[2])
told = {"robot_parameters": franky_sim.RobotParameters(ee_mass=float(sys.argv[3]))} if len(sys.argv) > 3 else {}
with MujocoSimulator() as simulator:
    simulator.add_robot(**told)
    with franky_sim.SimulationServer(simulator, hostname_candidates=[address]) as server:
        server.run_forever(slowness)
