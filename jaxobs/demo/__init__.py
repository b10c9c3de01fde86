"""The main job: a recorded walk, and the pendulum of paper 000. Everything here returns data; `report` draws it."""
