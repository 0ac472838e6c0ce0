"""How a mission looks: figures for print, a replay for the browser, an animation."""

import os

# matplotlib reads the backend when it is imported, and one that is not there, such as a notebook's
# where there is no notebook, is an error. We draw without any.
_backend = os.environ.pop("MPLBACKEND", None)
try:
    import matplotlib  # noqa: F401
finally:
    if _backend is not None:
        os.environ["MPLBACKEND"] = _backend
