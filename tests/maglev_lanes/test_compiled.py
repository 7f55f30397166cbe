"""The key of a kernel in the disk cache: what it reaches, and nothing else."""

from maglev_lanes.compiled import fingerprint

SCALE = 2.0


def scaled(a):
    """Not what it says that counts."""
    return SCALE * a


def made(factor):
    def kernel(a):
        return factor * scaled(a)

    return kernel


def own(function, monkeypatch):
    monkeypatch.setattr("maglev_lanes.compiled.OWN", (__name__, "maglev_lanes"))
    return fingerprint(function)


def test_it_changes_with_constants_of_the_factory_and_of_the_functions_that_are_reached(monkeypatch):
    before = own(made(3.0), monkeypatch)
    assert own(made(3.0), monkeypatch) == before
    assert own(made(4.0), monkeypatch) != before
    monkeypatch.setitem(globals(), "SCALE", 5.0)
    assert own(made(3.0), monkeypatch) != before


def test_it_does_not_change_with_what_is_said_of_a_function(monkeypatch):
    before = own(made(3.0), monkeypatch)

    def scaled(a):
        """Other words."""
        return SCALE * a

    scaled.__qualname__ = "scaled"
    monkeypatch.setitem(globals(), "scaled", scaled)
    assert own(made(3.0), monkeypatch) == before
