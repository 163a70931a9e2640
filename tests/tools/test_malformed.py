"""The campaign of malformed input: its samples are valid, its mutations do what they say, its judgement can fail."""

import shutil
from pathlib import Path
from random import Random

import pytest

from slrl_sumo.formats.trajectory_file import load_trajectories
from tools.malformed.__main__ import campaign, plan_inputs
from tools.malformed.judge import GIVE_UP_S, Outcome
from tools.malformed.mutations import BY_KIND, COMMON
from tools.malformed.samples import Sample, make_samples


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> list[Sample]:
    return make_samples(tmp_path_factory.mktemp("samples"))


def test_every_mutation_of_every_sample_changes_its_file(samples: list[Sample], tmp_path: Path) -> None:
    heavy = {"packed_bomb", "array_header", "picture", "long_line"}
    for sample in samples:
        before = (sample.folder / sample.target).read_bytes()
        for mutation in {m for m in (*COMMON, *BY_KIND[sample.kind]) if m.__name__ not in heavy}:
            target = tmp_path / Path(sample.target).name
            shutil.copy(sample.folder / sample.target, target)
            mutation(target, Random(1))
            changed = not target.is_file() or target.stat().st_size > 1 << 30 or target.read_bytes() != before
            assert changed, (sample.name, mutation.__name__)
            shutil.rmtree(target) if target.is_dir() else target.unlink(missing_ok=True)


def test_the_plan_has_every_sample_and_is_that_of_its_seed(samples: list[Sample]) -> None:
    plan = plan_inputs(samples, 120, 4)
    assert plan == plan_inputs(samples, 120, 4) != plan_inputs(samples, 120, 5)
    assert {sample for _, sample, _, _ in plan} == set(samples)
    assert len(load_trajectories(samples[0].folder.parent / "trajectories" / "a.npz")) == 240


def test_the_judgement_can_fail() -> None:
    names = {"a.csv"}
    good = Outcome(1, 20.0, 2.0, 300.0, "note: slow\nslrl-sumo: a.csv is damaged\n")
    assert good.faults(names) == []
    for outcome, fault in (
        (Outcome(4, 1.0, 1.0, 100.0, "slrl-sumo: a.csv: a defect\n"), "exit code 4"),
        (Outcome(-9, GIVE_UP_S + 1.0, 1.0, 100.0, ""), "given up"),
        (Outcome(1, 1.0, 1.0, 100.0, "Traceback\nslrl-sumo: a.csv\n"), "traceback"),
        (Outcome(1, 1.0, 1.0, 100.0, "slrl-sumo: a.csv\nmore\n"), "behind"),
        (Outcome(1, 1.0, 1.0, 100.0, "slrl-sumo: damaged\n"), "no file named"),
        (Outcome(1, 1.0, 11.0, 100.0, "slrl-sumo: a.csv\n"), "11.0 s"),
        (Outcome(0, 1.0, 1.0, 2000.0, ""), "2000 MiB"),
    ):
        assert any(fault in found for found in outcome.faults(names)), outcome


@pytest.mark.slow
def test_a_small_campaign_finds_nothing(tmp_path: Path) -> None:
    results = list(campaign(tmp_path, 12, 2, 2, only="import", studies=False))
    assert len(results) == 12
    assert not [result for result in results if result["faults"]]
