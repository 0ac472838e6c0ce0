import pytest
from browser import chromium


@pytest.fixture(scope="module")
def browser():
    """One Chromium for all the pages of a file."""
    with chromium() as browser:
        yield browser
