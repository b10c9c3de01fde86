"""Polytopes of error dynamics for the audit, its searches and its proofs."""

import numpy as np

from jaxobs.designs.polytope import Polytope

ONE = [[1.0, 0.0]]
NONE = np.zeros((2, 1))


def polytope(a, b, c, lower, upper):
    return Polytope(*(np.array(x, float) for x in (a, b, c, lower, upper, ONE)))


def oscillator(damping, low, high):
    """x'' + damping x' + k x = 0 with k between low and high."""
    return polytope([[0, 1], [0, -damping]], [[0], [-1]], ONE, [low], [high])


def between(a, b):
    """The segment from A to B as a polytope with one parameter of any rank."""
    u, s, v = np.linalg.svd(b - a)
    return Polytope(a, u * s, v, np.zeros(len(a)), np.ones(len(a)), np.eye(1, len(a)), tied=(0,) * len(a))


def turned(angle, k=6.0):
    """A matrix whose quadratic Lyapunov functions are long ellipses in one direction."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return turn @ np.array([[-1.0, k], [0.0, -1.0]]) @ turn.T
