"""Documents of scenarios that are put together."""


def joined(one, other):
    """Return two documents in one; lists of tables follow each other."""
    both = one | other
    for key in one.keys() & other.keys():
        a, b = one[key], other[key]
        if isinstance(a, dict) and isinstance(b, dict):
            both[key] = joined(a, b)
        elif isinstance(a, list) and isinstance(b, list):
            both[key] = a + b
    return both
