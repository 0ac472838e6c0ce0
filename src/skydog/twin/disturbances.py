"""What goes wrong on purpose, by name: motion capture, radio, air and floor."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Disturbances:
    """How much goes wrong. All of it is drawn from the mission's key.

    Values are ours; the gusts of `lab` are fitted to the paper's HDDPG-6x6-Phy.
    """

    mocap_noise: float = 0.0  # m, SD of each coordinate in each frame
    yaw_noise: float = 0.0  # rad, SD
    dropout: float = 0.0  # share of the frames in which a body is not seen
    observation_delay: float = 0.0  # s, of a frame
    action_delay: float = 0.0  # s, of a command, beyond the profile's own
    command_loss: float = 0.0  # share of the commands; a body obeys the last that came
    gust: float = 0.0  # m/s², SD on each axis, of what wind does to a drone, for about `GUST_LASTS`
    own_errors: float = 0.0  # share of the noise, drift and trim of the drone's own profile
    slip: float = 0.0  # SD of a wheel's slip, drawn anew every 5 s
    friction: float = 1.0  # of wheels on the floor


GUST_LASTS = 1.0  # s: the correlation time of gusts; ours
DRIFT_LASTS = 5.0  # s: tum_simulator, motionDriftNoiseTime

DISTURBANCES = {
    "none": Disturbances(),
    "mild": Disturbances(
        mocap_noise=0.0005,
        yaw_noise=0.0025,
        dropout=0.005,
        observation_delay=0.01,
        action_delay=0.01,
        command_loss=0.005,
        gust=0.1,
        own_errors=0.5,
        slip=0.01,
        friction=0.9,
    ),
    "lab": Disturbances(
        mocap_noise=0.001,
        yaw_noise=0.005,
        dropout=0.02,
        observation_delay=0.02,
        action_delay=0.02,
        command_loss=0.02,
        gust=0.25,
        own_errors=1.0,
        slip=0.03,
        friction=0.7,
    ),
}
