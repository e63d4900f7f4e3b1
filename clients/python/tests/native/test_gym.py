"""The environments of Gymnasium."""

import inspect

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

import rotortwin.gym  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402

IDS = [f"rotortwin/{name}-v0" for name in ("Hover", "Trajectory", "DamagedBlade", "LowBattery")]


@pytest.mark.parametrize("name", IDS)
@pytest.mark.filterwarnings("ignore:.*Box observation space")
def test_val_gymnasiums_own_checks_pass(name: str) -> None:
    check_env(gymnasium.make(name).unwrapped, skip_render_check=True)


def test_val_a_blade_breaks_on_the_rotor_that_the_seed_draws() -> None:
    # Our own controller flies, through the environment's actions.
    env = rotortwin.gym.FlightEnv("damaged-blade", duration_s=12.0)
    _, info = env.reset(seed=4)
    assert info["faulty_rotors"] == ()
    cut = False
    while not cut:
        flight = env._flight
        assert flight is not None
        action = (flight.controller_duty - flight.hover_duty) / rotortwin.gym.REACH
        observation, reward, terminated, cut, info = env.step(action.astype(np.float32))
        assert env.observation_space.contains(observation) and not terminated and reward <= 1.0
    assert len(info["faulty_rotors"]) == 1


def test_scenario_episodes_of_a_vector_end_and_begin_one_by_one() -> None:
    many = gymnasium.make_vec("rotortwin/Hover-v0", num_envs=3, duration_s=1.0)
    first, _ = many.reset(seed=1)
    again, _ = many.reset(seed=1)
    assert np.array_equal(first, again) and first.shape == many.observation_space.shape
    # The third motor group is stopped: this one falls out of its box before the others are cut.
    action = np.zeros((3, 6), np.float32)
    action[2] = -1.0
    ends = np.zeros(3, int)
    for _ in range(250):
        _, reward, terminated, truncated, _ = many.step(action)
        assert np.isfinite(reward).all()
        ends += terminated | truncated
    assert (ends[:2] == 2).all() and ends[2] >= 2


@pytest.mark.parametrize("name", IDS)
def test_val_a_vector_passes_the_checks_that_apply_to_it(name: str) -> None:
    """`check_env` of Gymnasium (1.4) takes single environments only; of its parts, those about seeds and options take a vector, too."""
    from gymnasium.utils import env_checker

    many = gymnasium.make_vec(name, num_envs=3)
    parts = {part: check for part, check in vars(env_checker).items() if part.startswith(("check_reset_seed", "check_reset_options"))}
    parts = {part: check for part, check in parts.items() if inspect.isfunction(check)}
    assert len(parts) >= 2, f"expected those of Gymnasium, got {list(parts)}"
    for check in parts.values():
        check(many)

    # The same seed and actions, the same episodes; shapes and types are those of the spaces; nothing returned is used again.
    many.action_space.seed(3)
    actions = [many.action_space.sample() for _ in range(40)]

    def flown() -> list[tuple[np.ndarray, ...]]:
        first, info = many.reset(seed=9)
        assert info == {} and many.observation_space.contains(first)
        rows: list[tuple[np.ndarray, ...]] = [(first,)]
        for action in actions:
            observation, reward, terminated, truncated, info = many.step(action)
            assert many.observation_space.contains(observation) and info == {}
            assert reward.shape == terminated.shape == truncated.shape == (3,)
            assert reward.dtype == np.float64 and terminated.dtype == truncated.dtype == np.bool_
            assert not any(np.shares_memory(observation, row[0]) for row in rows)
            rows.append((observation, reward, terminated, truncated))
        return rows

    for one, other in zip(flown(), flown(), strict=True):
        assert all(np.array_equal(mine, its) for mine, its in zip(one, other, strict=True))


@pytest.mark.parametrize("name", IDS)
def test_val_a_vector_of_one_is_the_single_environment(name: str) -> None:
    one, many = gymnasium.make(name).unwrapped, gymnasium.make_vec(name, num_envs=1)
    first, _ = one.reset(seed=21)
    firsts, _ = many.reset(seed=21)
    assert np.array_equal(firsts, first[None])
    one.action_space.seed(21)
    for _ in range(200):
        action = 0.1 * one.action_space.sample()
        observation, reward, terminated, truncated, _ = one.step(action)
        observations, rewards, ends, cuts, _ = many.step(action[None])
        assert np.array_equal(observations, observation[None]) and rewards[0] == reward
        assert (ends[0], cuts[0]) == (terminated, truncated)
        if terminated or truncated:
            break


def test_regress_an_unknown_task_is_named() -> None:
    with pytest.raises(ValueError, match="damaged-blade"):
        rotortwin.gym.FlightEnv("hoover")


def test_regress_what_is_no_action_is_no_crash() -> None:
    env = gymnasium.make("rotortwin/Hover-v0", disable_env_checker=True).unwrapped
    env.reset(seed=1)
    many = gymnasium.make_vec("rotortwin/Hover-v0", num_envs=2)
    many.reset(seed=1)
    for wrong in (np.zeros(5, np.float32), np.full(6, np.nan, np.float32)):
        with pytest.raises(ValueError, match="expected an action of"):
            env.step(wrong)
        with pytest.raises(ValueError, match="expected an action of"):
            many.step(np.stack([wrong, wrong]))


def test_scenario_a_blade_breaks_on_any_vehicle() -> None:
    quad = {"vehicle": "../vehicles/quad-x.toml"}
    for seed in range(8):
        env = gymnasium.make("rotortwin/DamagedBlade-v0", set=quad)
        _, info = env.reset(seed=seed)
        assert info["faulty_rotors"] == ()
