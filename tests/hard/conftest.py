"""What takes tens of seconds and has kin that takes less is left to the nights: `@night`."""
import os

import pytest


def pytest_configure(config):
    config.addinivalue_line("markers", "night: with --long alone")


def pytest_collection_modifyitems(items):
    if os.environ.get("MODALD_LONG") == "1":
        return
    for item in items:
        if item.get_closest_marker("night"):
            item.add_marker(pytest.mark.skip(reason="tens of seconds: --long"))
