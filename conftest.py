"""Examples in docstrings keep their caches to themselves."""

import pytest


@pytest.fixture(autouse=True)
def _own_cache(request, tmp_path_factory, monkeypatch):
    if isinstance(request.node, pytest.DoctestItem):
        monkeypatch.setenv("MOTIONKIT_CACHE", str(tmp_path_factory.mktemp("cache")))
