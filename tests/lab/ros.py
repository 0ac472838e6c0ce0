"""ROS 1 in tests: a process for each node, since rospy allows one in a process."""

import contextlib
import functools
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from importlib import import_module

import pytest

from skydog.lab.site import ROS1

pytest.importorskip("rospy", reason="rospy of ROS 1 is not here; see make ros")
pytest.importorskip("rosmaster", reason="rosmaster of ROS 1 is not here; see make ros")

PATIENCE = 30.0  # s
# A server that has imported once what every test needs; each test's process is a fork of it.
FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(
    ["hypothesis", "pytest", "skydog.lab.emulation.ros1", "skydog.lab.messages"]
)


def alone(test):
    """The test runs in a process of its own, which ends with it."""

    @functools.wraps(test)
    def run(**fixtures):
        ours, theirs = FORKS.Pipe(duplex=False)
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as home:
            arguments = (home, test.__module__, test.__name__, fixtures, theirs)
            process = FORKS.Process(target=_body, args=arguments, daemon=True)
            process.start()
            assert process.pid is not None
            theirs.close()
            try:
                said = ours.recv() if ours.poll(PATIENCE) else "it takes too long"
            except EOFError:
                said = "it died"
            if not said:
                process.join(PATIENCE)
                said = "" if process.exitcode == 0 else "something keeps the process from ending"
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # it, and the nodes that it started
            process.join()
        if said:
            pytest.fail(said)

    return run


def _body(home, module, name, fixtures, pipe):
    os.setsid()
    os.environ["ROS_HOME"] = home
    try:
        getattr(import_module(module), name).__wrapped__(**fixtures)
        pipe.send("")
    except BaseException:
        pipe.send(traceback.format_exc())
        os._exit(1)


def until(event):
    """Wait for what must come."""
    end = time.monotonic() + PATIENCE
    while not event():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.005)


def at(master):
    """The site's ROS 1, of a master."""
    return ROS1(master=master)


@contextlib.contextmanager
def python(program, master, *arguments):
    """Another node: a program, or a file, in a process of its own, killed at the end."""
    start = ("-c", program) if "\n" in program else (program,)
    with subprocess.Popen(
        [sys.executable, *start, *arguments],
        env={**os.environ, "ROS_MASTER_URI": master, "ROS_IP": "127.0.0.1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()
