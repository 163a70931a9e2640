from dataclasses import replace

import pytest

from slrl_sumo.learning.rl.selector_card import with_selector
from slrl_sumo.learning.supervised.model_card import model_card
from slrl_sumo.models.bundle import ModelBundle, load_bundle


def test_card_states_data_licence_sizes_and_errors(learned: ModelBundle) -> None:
    card = learned.card
    assert card.startswith("# Model bundle `made`\n")
    assert "| made traffic 2 | CC0-1.0 | 1 | 216 |" in card
    for kind, record in learned.training["types"].items():
        errors = f"| {kind} | {record['displacement_error_m']:.3f} | {record['constant_velocity_error_m']:.3f} |"
        assert errors in card
        sizes = f"| {record['windows']} | {record['held_out_windows']} | {record['smallest_mode']} |"
        assert f"| {kind} | {record['tracks']} {sizes}" in card
        slow, fast = record["speed_percentiles_mps"]
        few, many = record["within_20_m_percentiles"]
        assert 0.0 <= few < many
        assert f"| {kind} | {slow:.1f} to {fast:.1f} | {few:.0f} to {many:.0f} |" in card
    assert "seed 4, 15 epochs" in card
    assert card.endswith("\n")
    for line in card.splitlines():
        assert line.startswith("|") == line.endswith("|")


def test_card_says_where_the_licence_is_not_known(learned: ModelBundle) -> None:
    training = learned.training | {"recordings": [{"source": "", "licence": "", "tracks": 3}]}
    assert "| not stated | not stated | 1 | 3 |" in model_card("x", training)


@pytest.mark.parametrize("name", ["intersection", "shared-space"])
def test_cards_of_shipped_bundles_are_those_of_their_records(name: str) -> None:
    bundle = load_bundle(name)
    made = replace(bundle, card=model_card(name, bundle.training))
    if bundle.policy is not None:
        record = bundle.policy_training
        made = with_selector(made, bundle.policy, record, [record["last_updates"]])
    assert made.card == bundle.card
