"""Writes highway_env_ego.csv: the ego of highway-env 1.12 alone on its road under meta-actions, one row a step of 0.2 s.

Run with `python highway_env_ego.py > highway_env_ego.csv` where highway-env is installed.
"""

import gymnasium
import highway_env  # noqa: F401

ACTIONS = [3, 0, 1, 3, 2, 2, 4, 0, 4, 1]

env = gymnasium.make("highway-fast-v0", config={"vehicles_count": 0, "initial_lane_id": 1, "duration": 100})
env.reset(seed=0)
env = env.unwrapped
ego = env.vehicle
start_m = ego.position[0]
print("action,x_m,y_m,heading_rad,speed_mps")
for action in ACTIONS:
    env.action_type.act(action)
    for _ in range(5):
        env.road.act()
        env.road.step(0.2)
        x_m, y_m = ego.position
        print(f"{action},{x_m - start_m:.15g},{y_m:.15g},{ego.heading:.15g},{ego.speed:.15g}")
