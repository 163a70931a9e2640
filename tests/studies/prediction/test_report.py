import csv
import json
from pathlib import Path

import numpy as np
import pytest
from builders import make_recording

from slrl_sumo.errors import InputError
from slrl_sumo.formats.output_files import check_writable
from slrl_sumo.learning.supervised.windows import windows
from slrl_sumo.studies.prediction.modes_report import write_modes
from slrl_sumo.studies.prediction.plots import draw_errors, draw_modes
from slrl_sumo.studies.prediction.report import print_evaluation, write_evaluation


def a_result() -> dict[str, object]:
    rows = [
        {"selector": s, "type": "car", "step": k, "ade_m": k / 2, "fde_m": k * e, "min_ade_m": k / 4,
         "min_fde_m": k * e * b, "n": 20 - k}
        for s, e, b in (("constant-velocity", 1.0, 1.0), ("prior", 0.9, 0.5))
        for k in range(1, 17)
    ]  # fmt: skip
    return {
        "recording": "made", "bundle": "b", "seed": 1, "starts": 3, "starts_every": 5, "samples": 20, "reversing": 2,
        "notes": [], "surface": "everything is road",
    "expected_routes": ["car"], "rows": rows, "bends": rows[-1:], "driving": [],
        "realism": [{"selector": "prior", "type": "car", "score": 0.625, "n": 7, "groups": {"kinematic": 0.5},
                     "features": {"speed": 0.25, "standing": 0.75}}],
        "off_surface": [{"selector": "recorded", "type": "car", "share": 0.125, "steps": 80}],
    }  # fmt: skip


def test_files_hold_the_contract(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = a_result()
    write_evaluation(result, tmp_path / "out")
    assert json.loads((tmp_path / "out" / "results.json").read_text()) == result
    with open(tmp_path / "out" / "results.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert list(table[0]) == ["selector", "type", "step", "ade_m", "fde_m", "min_ade_m", "min_fde_m", "n"]
    assert [float(row["fde_m"]) for row in table] == [row["fde_m"] for row in result["rows"]]  # type: ignore[attr-defined]
    assert (tmp_path / "out" / "errors.png").read_bytes()[:4] == b"\x89PNG"
    print_evaluation(result)
    printed = capsys.readouterr().out
    assert "14.40" in printed  # the prior's error at the last step
    assert "everything is road" in printed
    assert "0.625" in printed
    assert "12.5%" in printed
    assert "cars that reverse, 2 times" in printed


def test_curves_are_the_final_errors_and_the_best_where_it_differs() -> None:
    axes = draw_errors(a_result()["rows"]).axes  # type: ignore[arg-type]
    assert len(axes) == 1
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in axes[0].lines}
    assert set(lines) == {"constant-velocity", "prior", "prior, best of samples"}
    np.testing.assert_allclose(lines["prior"], 0.9 * np.arange(1, 17))
    np.testing.assert_allclose(lines["prior, best of samples"], 0.45 * np.arange(1, 17))


def test_modes_are_drawn_with_as_many_windows_as_each_has() -> None:
    n = 20
    made = make_recording((0.1 * np.arange(n) ** 2, 0.0, 0.0))
    seen = windows([made])
    one = np.zeros(len(seen), np.int64)
    figure = draw_modes(seen, {"one": one, "two": np.minimum(np.arange(len(seen)), 1)}, 2)
    assert [axes.get_title() for axes in figure.axes[:2]] == ["one: 2 modes", "two: 2 modes"]
    assert figure.axes[2].containers[0].datavalues.tolist() == [len(seen), 0]  # type: ignore[attr-defined]
    assert figure.axes[3].containers[0].datavalues.tolist() == [1, len(seen) - 1]  # type: ignore[attr-defined]
    dots = np.asarray(figure.axes[1].collections[1].get_offsets())
    np.testing.assert_allclose(dots, [seen.destination[0], seen.destination[1:].mean(0)])


def test_pictures_of_modes_for_each_type_and_counts_of_both_clusterings(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    tracks, n = 30, 20
    kind = np.repeat([0, 2], tracks // 2)
    step = random.uniform(0.1, 3.0, tracks)[:, None] * np.arange(n)
    turn = random.uniform(-1.0, 1.0, tracks)[:, None] * np.linspace(0, 1, n)
    ways = zip(step * np.cos(turn), step * np.sin(turn), np.zeros(tracks), strict=True)
    made = make_recording(*ways, type=kind)
    write_modes([made], tmp_path / "modes", 1, ("car", "pedestrian"))
    assert {path.name for path in (tmp_path / "modes").iterdir()} == {
        "modes-car.png", "modes-pedestrian.png", "modes.csv",
    }  # fmt: skip
    with open(tmp_path / "modes" / "modes.csv", newline="") as file:
        table = list(csv.DictReader(file))
    for clustering in ("relative", "kmeans", "balanced", "curved"):
        mine = [row for row in table if row["clustering"] == clustering and row["type"] == "car"]
        assert sum(int(row["windows"]) for row in mine) == 15 * 6
        assert [int(row["mode"]) for row in mine] == list(range(20))


def test_places_that_cannot_be_written_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="is a file; name a folder"):
        check_writable(tmp_path / "file", folder=True)
    with pytest.raises(InputError, match="does not exist"):
        check_writable(tmp_path / "no" / "out", folder=True)
