"""A small environment of a user's own, a sketch for it, and options of `pirlc synth` with it."""

from __future__ import annotations

ENVIRONMENT = '''
"""A point on a line, pushed by the action; the nearer to 0 it stays, the better."""

import gymnasium as gym
import numpy as np
from gymnasium import spaces


class Point(gym.Env):
    observation_space = spaces.Box(-2.0, 2.0, (2,))
    action_space = spaces.Box(-1.0, 1.0, (1,))

    def __init__(self, fault=""):
        self.fault = fault

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place, self.speed = self.np_random.uniform(-1, 1), 0.0
        return self._seen(), {}

    def step(self, action):
        self.speed += 0.3 * float(action[0])
        self.place += 0.3 * self.speed
        if self.fault == "raises":
            raise RuntimeError("the belt slipped")
        reward = float("nan") if self.fault == "nan" else -abs(self.place)
        return self._seen(), reward, False, False, {}

    def _seen(self):
        return np.array([self.place, self.speed], dtype=np.float32)


gym.register("Point-v0", entry_point=Point, max_episode_steps=12)


def expert(observation):
    return -2.0 * observation[0] - 1.5 * observation[1]
'''

SKETCH = """policy point

environment "point_environment:Point-v0"

sensor Place : [-2, 2] = 0
sensor Speed : [-2, 2] = 1

action Push : [-1, 1] safe 0 = Law

rule Law = Term(Place)
         | Term(Place) + Term(Speed)

rule Term(x) = ?k * peek(x, -1)
"""

SYNTH = ("synth", "point.pirl", "--trust", "--episodes", "20", "--workers", "1")
GUIDED = ("--oracle", "point_environment:expert")
EXPERT = (*GUIDED, "--optimizer", "casadi")
