"""The zips of Stable-Baselines3: models that have learnt in our environments.

A zip holds pickles, which Stable-Baselines3 runs when it loads them.
"""

from pathlib import Path
from typing import Any

import numpy as np

from skydog import files
from skydog.errors import Refusal
from skydog.shepherds import finding
from skydog.shepherds.options import ObservationKind

LARGEST = 1 << 30  # bytes


def read(name: str) -> tuple[Any, ObservationKind]:
    """The `predict` of the model ALGORITHM:FILE.zip, and which observations it sees.

    It acts without exploring. The code in the zip is run. Raises `Refusal` for what is missing or
    cannot be loaded.
    """
    algorithm, _, path = name.partition(":")
    files.read_bytes(Path(path), "model of Stable-Baselines3", LARGEST)
    try:
        import stable_baselines3  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise Refusal(f"{name} needs Stable-Baselines3; run: pip install 'skydog[sb3]'") from None
    try:
        model = getattr(stable_baselines3, algorithm.upper()).load(path, device="cpu")
    except Exception as problem:
        said = str(problem).strip().split("\n")[0]
        raise Refusal(
            f"{path} is no {algorithm.upper()} of Stable-Baselines3 that can be loaded here: "
            f"{type(problem).__name__}: {said:.200}; name the one that it is of: "
            f"{', '.join(finding.ALGORITHMS)}"
        ) from problem
    if model.action_space.shape != (2,):
        raise Refusal(f"{path} acts in {model.action_space}; a dog takes two numbers from -1 to 1")

    shape = model.observation_space.shape

    def predict(seen: np.ndarray) -> np.ndarray:
        if seen.shape[1:] != shape:
            raise Refusal(
                f"{path} sees {' x '.join(map(str, shape))} numbers at a time; fly it with as many "
                "sheep and dogs as it has learnt with"
            )
        return model.predict(seen, deterministic=True)[0]

    return predict, "compact" if shape == (4,) else "full"
