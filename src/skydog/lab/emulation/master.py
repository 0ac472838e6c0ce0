# pyright: reportMissingImports=false
"""A ROS 1 master of our own, in a process of its own: for the emulated laboratory and the tests."""

import os
import subprocess
import sys

from skydog.errors import Refusal

# It lives as long as its standard input is open: it cannot outlive whoever started it.
PROGRAM = """
import sys
from rosmaster.master import Master
master = Master(int(sys.argv[1]))
master.start()
print(master.uri, flush=True)
sys.stdin.read()
master.stop()
"""


class Master:
    """A master that answers at `uri` until `close`; port 0 is any that is free.

    It listens on the loopback interface unless another address of ours is given.
    """

    def __init__(self, port: int = 0, address: str = "127.0.0.1"):
        try:
            import rosmaster  # noqa: F401
        except ImportError as missing:
            raise Refusal(
                "a ROS 1 master needs rosmaster; run make ros in a clone, or: apt install "
                "python3-rosmaster python3-rospy; DDS needs neither: --transport dds"
            ) from missing
        self._process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(port)],
            env={**os.environ, "ROS_IP": address},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            start_new_session=True,  # Ctrl-C is for whoever started it
        )
        assert self._process.stdout is not None
        self.uri = self._process.stdout.readline().strip()
        if not self.uri.startswith("http"):  # what it prints of a port that is taken
            self.close()
            raise Refusal(f"no ROS 1 master starts at port {port} of {address}; is it taken? try 0")

    @property
    def port(self) -> int:
        """The port where it listens."""
        return int(self.uri.rstrip("/").rpartition(":")[2])

    def kill(self) -> None:
        """Kill it as a power cut would."""
        self._process.kill()
        self._end()

    def close(self) -> None:
        """End it, and wait until it has. May be called twice."""
        self._process.terminate()
        self._end()

    def _end(self) -> None:
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            stream.close()
