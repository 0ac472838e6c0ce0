"""The shepherd in its own thread: what it answers, and what a bad one cannot do."""

import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from skydog.errors import Refusal
from skydog.lab.policy import Policy, Seen
from skydog.shepherds.strombom import Strombom
from skydog.world import mission
from skydog.world.presets import preset
from skydog.world.state import State

PATIENCE = 60.0  # s
WORLD = preset("paper-physical")
SHEEP = np.array([[3.3, 4.5], [3.6, 4.0], [4.5, 2.1]])
DOGS = np.array([[4.4, 5.0]])


@pytest.fixture
def policy():
    """Makes policies, and lets them go."""
    made = []

    def make(shepherd):
        made.append(Policy(WORLD, shepherd, 3, 1))
        return made[-1]

    yield make
    for one in made:
        one.close()


def ask(policy, step=0, sheep=SHEEP):
    policy.ask(Seen(step, sheep, DOGS, 0.0 * sheep))
    return policy.answer(PATIENCE)


def test_it_answers_what_the_shepherd_decides(policy):
    answer = ask(policy(Strombom()), 7)
    state = State(
        jnp.asarray(SHEEP, jnp.float32), jnp.asarray(DOGS, jnp.float32), jnp.zeros((3, 2))
    )
    decided = jax.jit(lambda state: mission.decide(WORLD, Strombom(), state))(state)
    for name in ("velocity", "force", "subgoal"):
        np.testing.assert_allclose(
            getattr(answer.decision, name), getattr(decided, name), atol=1e-5, err_msg=name
        )
    np.testing.assert_array_equal(answer.decision.drives, decided.drives)
    np.testing.assert_allclose(answer.moves.dogs[0], decided.velocity, atol=1e-5)
    np.testing.assert_allclose(answer.moves.sheep[0], 0.5 * np.asarray(decided.force), atol=1e-5)
    assert (answer.step, answer.accomplished) == (7, False)
    assert answer.took > 0.0


def test_it_sees_that_all_are_home(policy):
    assert ask(
        policy(Strombom()), sheep=np.array([[0.5, 0.5], [1.0, 0.5], [0.5, 1.0]])
    ).accomplished


def test_an_answer_is_given_once(policy):
    asked = policy(Strombom())
    assert ask(asked) is not None
    assert asked.answer(0.0) is None


def hanging(begun, go_on):
    """A shepherd that waits in each of its decisions."""

    def wait():
        begun.set()
        assert go_on.wait(PATIENCE)

    def shepherd(world, state):
        jax.debug.callback(wait)
        return jnp.zeros_like(state.dogs)

    return shepherd


def test_a_shepherd_that_hangs_keeps_nobody_waiting(policy):
    begun, go_on = threading.Event(), threading.Event()
    asked = policy(hanging(begun, go_on))
    try:
        asked.ask(Seen(0, SHEEP, DOGS, 0.0 * SHEEP))
        assert begun.wait(PATIENCE)
        assert asked.answer(0.01) is None
        asked.ask(Seen(1, SHEEP, DOGS, 0.0 * SHEEP))
        assert asked.answer(0.01) is None
    finally:
        go_on.set()


def test_of_two_questions_the_newest_is_answered(policy):
    begun, go_on = threading.Event(), threading.Event()
    asked = policy(hanging(begun, go_on))
    asked.ask(Seen(1, SHEEP, DOGS, 0.0 * SHEEP))
    assert begun.wait(PATIENCE)
    asked.ask(Seen(2, SHEEP, DOGS, 0.0 * SHEEP))
    go_on.set()
    assert asked.answer(PATIENCE).step == 2
    assert asked.answer(0.0) is None


def test_one_that_hangs_does_not_keep_it_from_being_let_go():
    begun, go_on = threading.Event(), threading.Event()
    asked = Policy(WORLD, hanging(begun, go_on), 3, 1)
    asked.ask(Seen(0, SHEEP, DOGS, 0.0 * SHEEP))
    assert begun.wait(PATIENCE)
    asked.close()
    go_on.set()
    asked._thread.join(PATIENCE)
    assert not asked._thread.is_alive()


def raising(world, state):
    raise ValueError("no way home")


def test_a_shepherd_that_raises_is_told_of(policy):
    asked = policy(raising)
    assert ask(asked) is None
    assert asked.problem == "ValueError: no way home"


def blind(world, state):
    return jnp.full_like(state.dogs, jnp.nan)


def test_what_is_no_number_stays_none_for_the_supervisor(policy):
    answer = ask(policy(blind))
    assert np.isnan(answer.moves.dogs).all()
    assert np.isfinite(answer.decision.velocity).all()  # what the trace has: it hovers


@pytest.mark.parametrize(
    ("shepherd", "why"),
    [
        (raising, "fails its self-test: ValueError: no way home"),
        (blind, "no number"),
        (lambda world, state: jnp.zeros((2, 2)), "shape"),
    ],
)
def test_the_self_test_refuses_a_shepherd_that_cannot_fly(policy, shepherd, why):
    with pytest.raises(Refusal, match=why):
        policy(shepherd).self_test(Seen(0, SHEEP, DOGS, 0.0 * SHEEP))


def test_the_self_test_leaves_no_trace_in_the_first_decision(policy):
    tested, fresh = policy(Strombom()), policy(Strombom())
    tested.self_test(Seen(0, SHEEP[::-1] - 1.0, DOGS, 0.0 * SHEEP))
    np.testing.assert_array_equal(ask(tested).decision.force, ask(fresh).decision.force)
