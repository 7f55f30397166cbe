import pytest

from maglev_env.recordings.guess import controller


@pytest.fixture(autouse=True)
def fewer_samples_to_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search of a controller takes most of the time here, and a third of its samples tell these controllers, too.

    tests/maglev_env/recordings tests the search itself, on all of its samples.
    """
    monkeypatch.setattr(controller, "_MOST", 1300)
