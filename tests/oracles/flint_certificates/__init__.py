"""Whether the theorem of a certificate file follows from its numbers: a second opinion in python-flint's rationals and balls.

Written from the docstrings of the theorems and the papers. It shares nothing with the checker: positive definite means that the
determinants of all leading minors are positive, positive semidefinite that the characteristic polynomial alternates, an
unstable eigenvalue is an isolated complex root, a matrix exponential is arb's.
"""

from oracles.flint_certificates import box, chain, negative, regional
from oracles.flint_certificates.fields import Fields, Malformed

JUDGES = {**box.JUDGES, **chain.JUDGES, **negative.JUDGES, **regional.JUDGES}


def judge(data):
    """True or False; None for data that are no certificate of a known theorem (a field missing, of another type or shape)."""
    decide = JUDGES.get(data.get("theorem"))
    try:
        return None if decide is None else all(decide(Fields(data)))
    except Malformed:
        return None
