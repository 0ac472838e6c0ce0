"""The base station in scripted time: what it says and does when something goes wrong."""

import threading
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from stations import PAD, When, a_small_site, mode, station

from skydog.flight.station import DT
from skydog.flight.supervisor import Mode, Order
from skydog.lab import flightlog, flying
from skydog.lab.flightlog import Flight, FlightLog
from skydog.lab.running import Automatic
from skydog.lab.setup import setup


def never(base):
    return False


def in_mission(base):
    return mode(base) == Mode.MISSION and base.step >= 3


def land_in_hold(base):
    if mode(base) == Mode.HOLD:
        base.orders.give(Order.LAND, "the test")


@pytest.fixture
def fly(monkeypatch, tmp_path):
    """Fly, and do something when something is so: how it ended, its lines, and its room."""

    def run(happens, act, site=None, watch=never, **options):
        site = site or a_small_site()
        with station(monkeypatch, tmp_path, site, **options) as (base, room, orders):
            when = When(orders, happens, lambda: act(base, room, orders))
            outcome = base.fly(lambda base: (watch(base), when(base))[1])
            return outcome, "\n".join(outcome.lines), room

    return run


def test_a_mission_takes_off_flies_its_steps_and_lands(fly):
    outcome, lines, room = fly(never, None)
    assert (outcome.how, outcome.steps) == ("out of time", 10)
    assert "taking off → mission: at height" in lines
    assert "landing → disarmed: landed" in lines
    assert room.drone.modes[:4] == [Mode.DISARMED, Mode.READY, Mode.TAKING_OFF, Mode.MISSION]
    assert room.drone.modes[-2:] == [Mode.LANDING, Mode.DISARMED]
    assert room.uav[2] == pytest.approx(PAD, abs=0.05)
    assert outcome.times.blind <= 2 * DT


def test_a_mission_whose_sheep_are_home_is_accomplished(fly):
    def at_home(base, room, orders):
        room.ugv[:, :2] = [(0.5, 0.5), (1.2, 0.5), (0.5, 1.2)]

    outcome, *_ = fly(lambda base: True, at_home)
    assert outcome.how == "accomplished"


def test_a_drone_that_is_carried_before_it_takes_off_climbs_where_it_stands(fly):
    level = []

    def carry(base, room, orders):
        room.uav[:2] = 2.0, 2.0

    def carried(base):
        if mode(base) == Mode.TAKING_OFF:
            level.append(float(np.abs(base.wires.drones[0].told.velocity[:2]).max()))
        return True

    fly(lambda base: True, carry, watch=carried)
    assert max(level) < 0.1


def test_the_log_of_a_flight_is_a_trace_of_its_mission(fly, tmp_path):
    site = a_small_site()
    flight = Flight("strombom", setup(site).world, ("uav1",), ("ugv1", "ugv2", "ugv3"), 10)
    log = FlightLog(tmp_path / "flight", "", {}, flight)
    fly(never, None, site, log=log)
    log.close()
    assert (log.problem, log.dropped) == (None, 0)
    trace, shepherd = flightlog.load(tmp_path / "flight")
    assert shepherd == "strombom"
    assert len(trace.time) == 11
    assert trace.poses is not None
    assert float(trace.poses.altitude[-1, 0]) == pytest.approx(2.0, abs=0.2)


def test_rovers_with_a_flock_of_their_own_are_told_nothing_and_others_may_command_them(fly):
    site = a_small_site()
    site = replace(site, mission=replace(site.mission, flock="own"))

    def another(base, room, orders):
        for rover in room.rovers:
            rover.also, rover.told = ("flock",), (0.01, 0.0)

    outcome, lines, room = fly(lambda base: True, another, site)
    assert outcome.how == "out of time"
    assert "too" not in lines
    assert {rover.told for rover in room.rovers} == {(0.01, 0.0)}  # its own flock's word


def test_ctrl_c_on_the_ground_leaves_and_takes_nothing_off(monkeypatch, tmp_path):
    with station(monkeypatch, tmp_path, a_small_site()) as (base, room, orders):
        over = Automatic(orders)

        def until(base):
            if base.memory.supervisor.mode[0] == Mode.READY:
                orders.quits = True
                orders.give(Order.STOP, "Ctrl-C")
            return over(base)

        base.fly(until)
    assert Mode.TAKING_OFF not in room.drone.modes


def test_a_stop_that_is_pulled_cannot_be_overridden(fly, tmp_path):
    def stop_and_resume(base, room, orders):
        (tmp_path / base.site.safety.stop_file).touch()
        orders.give(Order.RESUME, "key 'r'")

    def resume(base):
        if mode(base) == Mode.HOLD:
            base.orders.give(Order.RESUME, "key 'r'")

    _, lines, _ = fly(in_mission, stop_and_resume, watch=resume)
    assert "resume by key 'r' refused: file STOP is there" in lines
    assert "well again" not in lines
    assert "landing: operator: land (file STOP)" in lines


def test_a_second_publisher_is_named_and_lands_the_drone(fly):
    def another(base, room, orders):
        room.drone.also = ("teleop",)

    outcome, lines, _ = fly(in_mission, another)
    assert "teleop commands uav1 too" in lines
    assert "mission → landing: second publisher" in lines
    assert outcome.how == "stopped by the supervisor"


def test_an_order_that_is_refused_says_why(monkeypatch, tmp_path):
    with station(monkeypatch, tmp_path, a_small_site()) as (base, room, orders):
        room.drone.said = room.drone.said._replace(battery=0.01)
        over, asked = Automatic(orders, patience=2.0), []

        def until(base):
            if not asked:
                asked.append(orders.give(Order.ARM, "key 'a'"))
            return over(base)

        lines = "\n".join(base.fly(until).lines)
    assert "arm by key 'a' refused while disarmed" in lines
    assert "not ready: battery of uav1: 1%" in lines
    assert room.drone.modes == [Mode.DISARMED]


def test_keys_that_were_pressed_before_anybody_was_seen_arm_nothing(monkeypatch, tmp_path):
    with station(monkeypatch, tmp_path, a_small_site()) as (base, room, orders):
        orders.give(Order.ARM, "key 'a'")
        orders.give(Order.TAKE_OFF, "key 't'")
        base.fly(lambda base: base.memory.now - base.began > 2.0)
    assert room.drone.modes == [Mode.DISARMED]


def test_whoever_leaves_before_anybody_is_seen_leaves(monkeypatch, tmp_path):
    with station(monkeypatch, tmp_path, a_small_site()) as (base, room, orders):
        room.hidden.add("ugv2")
        orders.quits = True
        assert base.fly(lambda base: False).how == "stopped by the supervisor"


def test_a_body_that_is_missed_holds_everything_until_it_is_seen_again(fly):
    speeds = []

    def hide(base, room, orders):
        room.hidden.add("ugv2")

    def watch(base):
        if mode(base) == Mode.HOLD:
            speeds.extend(abs(rover.told[0]) for rover in base.wires.rovers)
            base.wires.source.hidden.clear()

    outcome, lines, _ = fly(in_mission, hide, watch=watch)
    assert "mission → hold: eyes stale (ugv2 not seen for 0.1" in lines
    assert ": missing)" in lines
    assert "hold → mission: well again" in lines
    assert min(speeds) < max(speeds) <= 0.5  # they brake as their wheels allow
    assert outcome.how == "out of time"
    assert 0.1 <= outcome.times.blind <= 0.15


def test_bodies_that_stay_unseen_land_the_drone_and_call_the_operator(fly):
    def hide(base, room, orders):
        room.hidden.add("uav1")

    def watch(base):
        if mode(base) == Mode.LANDING and base.memory.now - base.memory.supervisor.since[0] > 2.0:
            base.wires.source.hidden.clear()

    outcome, lines, room = fly(in_mission, hide, watch=watch)
    assert "hold → landing: eyes stale long (uav1 not seen for 0.5" in lines
    assert "ALARM" in lines
    assert room.drone.modes[-1] == Mode.DISARMED
    assert outcome.times.blind < 0.55


def test_a_shepherd_that_hangs_holds_everything_and_the_loop_goes_on(fly, monkeypatch):
    go_on, hangs = threading.Event(), threading.Event()

    def wait():
        if hangs.is_set():
            go_on.wait(60.0)

    def shepherd(world, state):
        jax.debug.callback(wait)
        return jnp.zeros_like(state.dogs)

    def hang(base, room, orders):
        hangs.set()
        monkeypatch.setattr(flying, "PATIENCE", 0.0)  # of real time, of which none passes here

    try:
        _, lines, _ = fly(in_mission, hang, watch=land_in_hold, shepherd=shepherd)
    finally:
        go_on.set()
    assert "mission → hold: policy silent" in lines
    assert "hold → landing: operator: land" in lines


def test_a_shepherd_that_decides_on_no_number_is_held(fly):
    def shepherd(world, state):
        return jnp.full_like(state.dogs, jnp.nan)

    _, lines, room = fly(never, None, watch=land_in_hold, shepherd=shepherd)
    assert "mission → hold: policy silent" in lines
    assert np.isfinite(room.uav).all()


def test_a_shepherd_that_raises_is_told_of(fly):
    fails = threading.Event()

    def fail():
        if fails.is_set():
            raise ValueError("no way home")

    def shepherd(world, state):
        jax.debug.callback(fail)
        return jnp.zeros_like(state.dogs)

    _, lines, _ = fly(in_mission, lambda *_: fails.set(), watch=land_in_hold, shepherd=shepherd)
    assert "no way home" in lines
    assert "mission → hold: policy silent" in lines


def test_space_holds_then_lands_then_cuts_the_motors(fly):
    def watch(base):
        if mode(base) in (Mode.HOLD, Mode.LANDING):
            base.orders.give(Order.STOP, "key ' '")
        if mode(base) == Mode.EMERGENCY:
            base.orders.give(Order.RESET, "key 'R'")

    outcome, lines, room = fly(
        in_mission, lambda base, room, orders: orders.give(Order.STOP, "key ' '"), watch=watch
    )
    assert "mission → hold: operator: stop (key ' ')" in lines
    assert "hold → landing: operator: stop" in lines
    assert "landing → emergency: operator: stop" in lines
    assert Mode.EMERGENCY in room.drone.modes
    assert outcome.how == "stopped by the supervisor"


def test_a_stop_file_keeps_a_drone_on_the_ground(monkeypatch, tmp_path):
    (tmp_path / "STOP").touch()
    with station(monkeypatch, tmp_path, a_small_site()) as (base, room, orders):
        lines = "\n".join(base.fly(Automatic(orders, patience=2.0)).lines)
    assert "file STOP is there" in lines
    assert room.drone.modes == [Mode.DISARMED]


def test_a_rover_that_is_stuck_is_named_once(fly):
    def jam(base, room, orders):
        room.stuck.add(0)

    def herd(world, state):
        return jnp.array([[0.3, -0.2]])

    _, lines, _ = fly(in_mission, jam, site=a_small_site(steps=38), shepherd=herd)
    assert lines.count("ugv1 is commanded to drive and does not move") == 1


def test_a_view_comes_ten_times_a_second(fly):
    views = []
    outcome, _, _ = fly(never, None, show=views.append)
    seconds = views[-1].now - views[0].now
    assert len(views) == pytest.approx(10 * seconds, rel=0.15)
    assert {view.mode for view in views} >= {Mode.TAKING_OFF, Mode.MISSION, Mode.LANDING}
    assert views[-1].step == outcome.steps
