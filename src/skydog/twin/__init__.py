"""The physics twin: a quadrotor and rovers in MuJoCo that fly `skydog.flight`.

`Twin` is a `Fly` as `skydog.study.evaluate.fly` is: whatever flies in the kinematic world flies
here, and records the same trace. `pip install 'skydog[twin]'` brings the physics.
"""

import os

from skydog.errors import Refusal

try:
    import mujoco as _mujoco  # noqa: F401 - whoever imports the twin gets this one line
    from mujoco import batch as _batch  # noqa: F401
except ImportError:
    raise Refusal("the twin needs MuJoCo 4.0 or newer; run: pip install 'skydog[twin]'") from None
except AttributeError:  # what MuJoCo raises where the OpenGL that MUJOCO_GL names is missing
    raise Refusal(
        f"MuJoCo finds no OpenGL for MUJOCO_GL={os.environ.get('MUJOCO_GL')}; unset it, or install "
        "libosmesa6 for osmesa"
    ) from None

from skydog.twin.disturbances import DISTURBANCES, Disturbances
from skydog.twin.missions import Twin

__all__ = ["DISTURBANCES", "Disturbances", "Twin"]
