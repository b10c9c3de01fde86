"""Paper 000, claim by claim."""
