"""Slow, plain, independent: each formula by another road than the package takes, and no code shared with it."""
