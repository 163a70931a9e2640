import json
import os
import shutil
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from slrl_sumo.errors import InputError
from slrl_sumo.models import bundle_folder
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.bundle_folder import FILES, SHIPPED, shipped_bundles
from slrl_sumo.perception.observation import Observation


def test_what_is_saved_is_loaded(bundle: ModelBundle, seen: Observation, tmp_path: Path) -> None:
    bundle.save(tmp_path / "made")
    loaded = load_bundle(tmp_path / "made")
    assert (loaded.name, loaded.config, loaded.training, loaded.card) == (
        bundle.name,
        bundle.config,
        bundle.training,
        bundle.card,
    )
    np.testing.assert_array_equal(loaded.mode_centres, bundle.mode_centres)
    np.testing.assert_array_equal(loaded.mode_counts, bundle.mode_counts)
    np.testing.assert_array_equal(loaded.max_speed, [15.0, 8.0, 2.5])
    for one, other in ((loaded.displacement, bundle.displacement), (loaded.prior, bundle.prior)):
        torch.testing.assert_close(dict(one.state_dict()), dict(other.state_dict()), rtol=0, atol=0)
    modes = np.arange(300) % 20
    for read, written in zip(loaded.motion(seen, modes), bundle.motion(seen, modes), strict=True):
        assert read.dtype == np.float64
        np.testing.assert_array_equal(read, written)
    assert len({(tmp_path / "made" / file).stat().st_mode for file in FILES}) == 1  # whoever may read one may read all
    assert sorted(p.name for p in tmp_path.rglob("*")) == sorted(["made", *FILES])  # nothing temporary stays behind


def test_saving_twice_gives_the_same_bytes_and_replaces(bundle: ModelBundle, tmp_path: Path) -> None:
    bundle.save(tmp_path / "a")
    bundle.save(tmp_path / "b")
    (tmp_path / "a" / "MODEL_CARD.md").write_text("old")
    bundle.save(tmp_path / "a")
    for file in FILES:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b"]


def test_save_refuses_what_is_not_a_bundle(bundle: ModelBundle, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    thesis = tmp_path / "thesis"
    thesis.mkdir()
    (thesis / "chapter.tex").write_text("mine")
    bundle.save(tmp_path / "bundle")
    (tmp_path / "bundle" / "notes.txt").write_text("mine")
    for target in (file, thesis, tmp_path / "bundle"):
        with pytest.raises(InputError, match="something else is there"):
            bundle.save(target)
    assert file.read_text() == (thesis / "chapter.tex").read_text() == (tmp_path / "bundle/notes.txt").read_text()
    (tmp_path / "empty").mkdir()
    bundle.save(tmp_path / "empty")
    assert load_bundle(tmp_path / "empty").name == "random"
    with pytest.raises(InputError, match="cannot write"):
        bundle.save(file / "below")


def test_save_that_fails_leaves_the_old_bundle(
    bundle: ModelBundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundle.save(tmp_path / "a")
    rename = os.rename

    def full(source: Path, target: Path) -> None:
        if Path(source).name == "new":
            raise OSError(28, "No space left on device")
        rename(source, target)

    monkeypatch.setattr(os, "rename", full)
    with pytest.raises(InputError, match="No space left"):
        bundle.save(tmp_path / "a")
    monkeypatch.undo()
    assert load_bundle(tmp_path / "a").name == "random"
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_names_are_looked_up_among_the_shipped_bundles(
    bundle: ModelBundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bundle_folder, "SHIPPED", tmp_path)
    assert shipped_bundles() == []
    bundle.save(tmp_path / "west")
    bundle.save(tmp_path / "east")
    assert shipped_bundles() == ["east", "west"]
    assert load_bundle("west").name == "random"
    with pytest.raises(InputError, match=r"no bundle north.*\(east, west\)"):
        load_bundle("north")


@pytest.mark.parametrize("file", FILES)
def test_a_missing_file_is_named(bundle: ModelBundle, tmp_path: Path, file: str) -> None:
    bundle.save(tmp_path / "a")
    (tmp_path / "a" / file).unlink()
    with pytest.raises(InputError, match=f"{file} missing"):
        load_bundle(tmp_path / "a")


@pytest.mark.parametrize("file", ["config.json", "weights.safetensors", "training.json"])
@pytest.mark.parametrize("content", [b"", b"[1]", b"{", b"\xff\xfe\x00"])
def test_a_damaged_file_is_named(bundle: ModelBundle, tmp_path: Path, file: str, content: bytes) -> None:
    bundle.save(tmp_path / "a")
    (tmp_path / "a" / file).write_bytes(content)
    with pytest.raises(InputError, match=f"{file} is damaged") as error:
        load_bundle(tmp_path / "a")
    assert "\n" not in str(error.value)


def test_half_the_weights_are_damage(bundle: ModelBundle, tmp_path: Path) -> None:
    bundle.save(tmp_path / "a")
    file = tmp_path / "a" / "weights.safetensors"
    file.write_bytes(file.read_bytes()[:2000])
    with pytest.raises(InputError, match=r"weights\.safetensors is damaged"):
        load_bundle(tmp_path / "a")


def refused_with(file: Path, key: str, value: object, message: str) -> None:
    """Change a value in a JSON file of a bundle, which is then refused in one line."""
    file.write_text(json.dumps(json.loads(file.read_text()) | {key: value}))
    with pytest.raises(InputError, match=message) as error:
        load_bundle(file.parent)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("format_version", 2, "format version is 2"),
        ("preset", "extended", "preset is 'extended'"),
        ("features", ["speed"], "features is"),
        ("decision_interval_s", 0.5, "decision_interval_s is 0.5"),
        ("modes", "many", "sizes"),
        ("modes", 0, "sizes"),
        ("modes", 10, r"is \(.*\) .* instead of"),
        ("displacement_hidden", [8], "weights.safetensors is damaged"),
        ("prior_hidden", 8, "config.json is damaged"),
        ("colour", "red", "colour"),
    ],
)
def test_another_configuration_is_refused(
    bundle: ModelBundle, tmp_path: Path, key: str, value: object, message: str
) -> None:
    bundle.save(tmp_path / "a")
    refused_with(tmp_path / "a" / "config.json", key, value, message)


def test_weights_of_another_shape_or_not_finite_are_refused(bundle: ModelBundle, tmp_path: Path) -> None:
    bundle.save(tmp_path / "a")
    file = tmp_path / "a" / "weights.safetensors"
    good = load_file(file)
    nan = good["prior.networks.mean"].clone()
    nan[1, 2] = torch.nan
    short = {k: v for k, v in good.items() if k != "mode_counts"}
    for changed, message in (
        (good | {"mode_centres": good["mode_centres"][:, :5].clone()}, "mode_centres is"),
        (good | {"mode_counts": good["mode_counts"].float()}, "mode_counts is"),
        (good | {"prior.networks.mean": nan}, "prior.networks.mean is not finite"),
        (short, "mode_counts missing"),
        (good | {"extra": torch.zeros(1)}, "extra unknown"),
    ):
        save_file(changed, file)
        with pytest.raises(InputError, match=message):
            load_bundle(tmp_path / "a")


def test_bundles_of_the_paper_stay_beside_those_that_know_routes() -> None:
    assert {"intersection", "intersection-paper", "shared-space", "shared-space-paper"} <= set(shipped_bundles())
    for name in ("intersection", "shared-space"):
        paper, usual = load_bundle(f"{name}-paper"), load_bundle(name)
        assert paper.policy is not None
        assert paper.policy.config.preset == "paper"
        assert usual.policy is not None
        assert usual.policy.config.preset == "extended"
        # In `shared-space` only the selectors differ; those of `intersection` that know routes need other modes.
        same = [
            torch.equal(one, other)
            for part in ("displacement", "prior")
            for one, other in zip(
                getattr(paper, part).state_dict().values(), getattr(usual, part).state_dict().values(), strict=True
            )
        ]
        assert all(same) == (name == "shared-space")
        assert usual.training["modes_by"] == ("accelerations" if name == "intersection" else paper.training["modes_by"])


def test_nothing_is_allocated_before_the_sizes_are_those_of_the_weights(bundle: ModelBundle, tmp_path: Path) -> None:
    bundle.save(tmp_path / "a")
    config = tmp_path / "a" / "config.json"
    # 3 types x 20 modes x 4096 x 4096 x 4 bytes: 4 GB for each layer.
    config.write_text(json.dumps(json.loads(config.read_text()) | {"displacement_hidden": [4096] * 3}))
    tracemalloc.start()
    with pytest.raises(InputError, match=r"weights\.safetensors is damaged"):
        load_bundle(tmp_path / "a")
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 20e6  # bytes


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("hidden", 60_000),
        ("hidden", 10**12),
        ("hidden", "128"),
        ("channels", [16] * 1000),
        ("channels", 5),
        ("modes", 21),
        ("preset", 3),
        ("training", [1]),
    ],
)
def test_a_selector_of_impossible_sizes_is_refused(tmp_path: Path, key: str, value: object) -> None:
    shutil.copytree(SHIPPED / "intersection", tmp_path / "a")
    refused_with(tmp_path / "a" / "selector.json", key, value, "selector")


def test_bounds_that_no_road_user_has_are_refused(bundle: ModelBundle, tmp_path: Path) -> None:
    bundle.save(tmp_path / "a")
    file = tmp_path / "a" / "weights.safetensors"
    state = load_file(file)
    save_file(state | {"displacement.max_speed": torch.full((3,), 1e30)}, file)
    with pytest.raises(InputError, match="max_speed is above 200"):
        load_bundle(tmp_path / "a")


def test_the_hardest_braking_is_the_recorded_one_and_the_bound_of_the_models_where_it_is_not_known(
    bundle: ModelBundle, tmp_path: Path
) -> None:
    recorded = replace(bundle, training={"types": {"car": {"hardest_braking_mps2": -50.0}}})
    assert recorded.hardest_braking.tolist() == [-50.0, *bundle.usual_braking[1:].tolist()]
    bundle.save(tmp_path / "a")
    file = tmp_path / "a" / "training.json"
    for value in (1.0, "-3", -1e9, None):
        file.write_text(json.dumps({"types": {"pedestrian": {"hardest_braking_mps2": value}}}))
        with pytest.raises(InputError, match="hardest_braking_mps2 is"):
            load_bundle(tmp_path / "a")


@pytest.mark.parametrize("file", ["config.json", "training.json"])
def test_deep_brackets_in_a_bundle_are_damage(bundle: ModelBundle, tmp_path: Path, file: str) -> None:
    bundle.save(tmp_path / "a")
    (tmp_path / "a" / file).write_text('{"a":' * 50_000)
    with pytest.raises(InputError, match="nested too deeply"):
        load_bundle(tmp_path / "a")
