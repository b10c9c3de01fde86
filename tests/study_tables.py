"""The tables of a small study, as `jaxobs study` reads them."""

TINY = """
[plant]
name = "Pendulum"
[observer]
name = "HighGain"
alphas = [2.0, 1.0]
gamma = [2.0, 4.0]
[signal]
name = "Sine"
amplitude = 0.5
[noise]
name = "Gaussian"
sigma = [0.01, 0.1]
[time]
end = 0.2
dt = 0.02
[start]
x0 = [[0.5, 0.0], [0.3, 0.1]]
[metrics]
rmse = { kind = "RMSE", after = 0.1 }
peak = "Peak"
[run]
seeds = 3
key = 7
integrator = "Euler"
"""
