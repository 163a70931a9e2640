"""The command line: words, exit codes, what is printed and what is left behind."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.simulation.run import run

Cli = Callable[..., subprocess.CompletedProcess[str]]
Copy = Callable[..., Path]

# The contract of `run --summary`: scripts of others rely on these.
NUMBER = (int, float)
KEYS = {
    "scenario": str,
    "seed": int,
    "bundle": str,
    "selector": str,
    "decisions": int,
    "decision_interval_s": float,
    "wall_s": NUMBER,
    "real_time_factor": NUMBER,
    "agent_steps": int,
    "agent_steps_per_s": NUMBER,
    "lost": int,
    "wrapped_around": int,
    "taken_over": int,
    "handed_back": int,
    "per_type": dict,
}
KEYS_PER_TYPE = {
    "count": int,
    "mean_speed_mps": NUMBER,
    "standing_share": NUMBER,
    "collisions": int,
    "near_misses": int,
    "survival_steps": NUMBER,
    "success_rate": NUMBER,
    "off_surface_share": NUMBER,
}


@pytest.mark.parametrize("words", [["--help"], ["run", "--help"], ["--version"], ["scenarios"]])
def test_help_imports_nothing_heavy(words: list[str]) -> None:
    program = (
        "import sys, slrl_sumo.cli\n"
        f"sys.argv = ['slrl-sumo', *{words!r}]\n"
        "try:\n    slrl_sumo.cli.main()\n"
        "except SystemExit as end:\n    assert not end.code, end.code\n"
        "heavy = {'torch', 'libsumo', 'matplotlib', 'cv2', 'sklearn', 'numpy'} & set(sys.modules)\n"
        "print('heavy:', sorted(heavy))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "heavy: []"


@pytest.mark.parametrize("selector", ["rule", "greedy", "sampled", "prior"])
def test_a_run_without_images_imports_neither_torch_nor_trees_and_algebra_of_scipy(selector: str) -> None:
    program = (
        "import sys\n"
        "from slrl_sumo.simulation.run import run\n"
        "from slrl_sumo.simulation.settings import RunSettings\n"
        f"for event in run(RunSettings(scenario='intersection', agents=4, steps=2, selector={selector!r})): pass\n"
        "print({'torch', 'scipy.spatial', 'scipy.linalg'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout.strip()) == (0, "set()"), done.stderr


def test_help_names_the_commands_and_version_is_the_packages(cli: Cli) -> None:
    import slrl_sumo

    text = cli("--help").stdout
    for command in ("scenarios", "run", "generate", "record", "fit"):
        assert command in text
    assert cli("--version").stdout.strip() == slrl_sumo.__version__


@pytest.mark.parametrize(
    "words",
    [
        ["nonsense"],
        ["run"],
        ["run", "intersection", "--agents", "many"],
        ["run", "intersection", "--agents", "3", "--speed", "9"],
        ["generate", "intersection"],
        ["fit", "--out", "b"],
    ],
)
def test_wrong_usage_is_exit_code_2(cli: Cli, words: list[str], tmp_path: Path) -> None:
    done = cli(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert "Usage: " in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def check_summary(result: dict[str, object]) -> None:
    for key, kind in KEYS.items():
        assert isinstance(result[key], kind), key
        assert not isinstance(result[key], bool), key
    per_type = result["per_type"]
    assert isinstance(per_type, dict)
    assert list(per_type) == list(TYPE_NAMES)
    for name, values in per_type.items():
        assert set(values) == set(KEYS_PER_TYPE), name
        for key, kind in KEYS_PER_TYPE.items():
            # Means over no road users are null.
            assert isinstance(values[key], kind) or (values["count"] == 0 and values[key] is None), f"{name} {key}"
        for key in ("standing_share", "success_rate", "off_surface_share"):
            assert values[key] is None or 0 <= values[key] <= 1


def colours(file: Path) -> int:
    """Number of clearly different colours in a picture."""
    picture = cv2.imread(str(file))
    assert picture is not None
    assert min(picture.shape[:2]) > 200
    return len(np.unique(picture.reshape(-1, 3) // 32, axis=0))


def test_a_run_leaves_a_table_a_summary_and_pictures(cli: Cli, tmp_path: Path) -> None:
    done = cli(
        *("run", "intersection", "--agents", 12, "--steps", 45, "--seed", 5),
        *("--summary", "s.json", "--report", "pictures"),
        cwd=tmp_path,
    )
    assert (done.returncode, done.stderr) == (0, "")
    result = json.loads((tmp_path / "s.json").read_text())
    check_summary(result)
    assert (result["scenario"], result["seed"], result["bundle"]) == ("intersection", 5, "intersection")
    assert (result["selector"], result["decisions"], result["decision_interval_s"]) == ("greedy", 45, 0.4)
    assert result["agent_steps"] == 540
    assert sum(result["per_type"][name]["count"] for name in TYPE_NAMES) == 12
    assert result["real_time_factor"] == pytest.approx(45 * 0.4 / result["wall_s"], rel=0.01)
    assert result["agent_steps_per_s"] == pytest.approx(540 / result["wall_s"], rel=0.01)
    for name in TYPE_NAMES:
        assert name in done.stdout
    assert "540 agent-steps" in done.stdout
    # Roads, pavements and the colours of three types; not a blank page.
    pictures = ["conflicts", "density", "ego_images", "modes", "motion", "paths", "queues", "space_time"]
    names = [*(f"{name}{page}.png" for name in pictures for page in ("", "-dark")), "report.html"]
    assert sorted(p.name for p in (tmp_path / "pictures").iterdir()) == sorted(names)
    assert colours(tmp_path / "pictures" / "paths.png") > 8
    assert colours(tmp_path / "pictures" / "ego_images.png") > 8
    assert sorted(p.name for p in tmp_path.iterdir()) == ["pictures", "s.json"]


def test_without_wishes_nothing_is_written_and_quiet_prints_nothing(cli: Cli, tmp_path: Path) -> None:
    done = cli("run", "shared-space", "--agents", 3, "--steps", 3, "--mix", "bicycle=1", "--quiet", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_absent_types_are_null_in_the_summary(cli: Cli, tmp_path: Path) -> None:
    done = cli(
        *("run", "intersection", "--agents", 2, "--steps", 5, "--mix", "pedestrian=1", "--summary", "s.json"),
        cwd=tmp_path,
    )
    assert done.returncode == 0
    result = json.loads((tmp_path / "s.json").read_text())
    check_summary(result)
    assert result["per_type"]["car"]["count"] == 0
    assert result["per_type"]["car"]["mean_speed_mps"] is None
    assert "pedestrian" in done.stdout
    assert "bicycle" not in done.stdout


@pytest.mark.slow
def test_from_a_generated_network_to_a_run_of_a_bundle_learned_on_it(cli: Cli, tmp_path: Path) -> None:
    made = cli("generate", "intersection", "--seed", 11, "--out", "net", cwd=tmp_path)
    assert (made.returncode, made.stderr) == (0, "")
    config = tmp_path / made.stdout.strip()
    assert config.suffix == ".sumocfg"
    recorded = cli("record", config, "--out", "traffic.npz", "--seconds", 400, cwd=tmp_path)
    assert (recorded.returncode, recorded.stderr) == (0, "")
    assert "tracks" in recorded.stdout
    learned = cli("fit", "traffic.npz", "--out", "mine", "--epochs", 1, cwd=tmp_path)
    assert (learned.returncode, learned.stderr) == (0, ""), learned.stderr
    assert (tmp_path / "mine" / "MODEL_CARD.md").is_file()
    ran = cli(*("run", config, "--bundle", "mine", "--agents", 6, "--steps", 10, "--summary", "s.json"), cwd=tmp_path)
    assert (ran.returncode, ran.stderr) == (0, "")
    result = json.loads((tmp_path / "s.json").read_text())
    check_summary(result)
    assert result["bundle"] == "mine"
    assert result["scenario"] == config.stem
    assert {p.name for p in tmp_path.iterdir()} == {"net", "traffic.npz", "mine", "s.json"}


@pytest.mark.slow
def test_a_guarded_run_goes_another_way(cli: Cli, tmp_path: Path) -> None:
    words = ["run", "intersection", "--agents", 16, "--steps", 40, "--selector", "prior", "--summary", "s.json"]
    summaries = []
    for more in ([], ["--guard"]):
        done = cli(*words, *more, cwd=tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
        summaries.append(json.loads((tmp_path / "s.json").read_text()))
        check_summary(summaries[-1])
    assert summaries[1]["agent_steps"] == 640
    assert summaries[0]["per_type"] != summaries[1]["per_type"]


# What people type wrong: words after `run` (or another command), and words that the one line must hold.
WRONG = {
    "unknown scenario": (["run", "nowhere", "--agents", "3"], "nowhere: no such file"),
    "no_users": (["run", "intersection", "--agents", "0"], "--agents 0"),
    "too many": (["run", "intersection", "--agents", "5000"], "--agents 5000: only"),
    "far too many": (["run", "intersection", "--agents", "99999999999999999999"], "--agents 99999999999999999999"),
    "unknown bundle": (["run", "intersection", "--agents", "3", "--bundle", "nothing"], "no bundle nothing"),
    "unknown selector": (["run", "intersection", "--agents", "3", "--selector", "best"], "--selector best"),
    "guard of lanes": (
        ["run", "intersection", "--agents", "3", "--selector", "lane", "--guard"],
        "--guard: --selector lane chooses no modes; leave the guard out, or take another selector",
    ),
    "step": (["run", "intersection", "--agents", "3", "--step-length", "0.3"], "--step-length 0.3"),
    "no steps": (["run", "intersection", "--agents", "3", "--steps", "0"], "--steps 0"),
    "steps and until": (["run", "intersection", "--agents", "3", "--steps", "2", "--until", "9"], "--until"),
    "until the past": (["run", "intersection", "--agents", "3", "--until", "0"], "--until 0"),
    "until nan": (["run", "intersection", "--agents", "3", "--until", "nan"], "--until nan"),
    "until inf": (["run", "intersection", "--agents", "3", "--until", "inf"], "--until inf"),
    "seed": (["run", "intersection", "--agents", "3", "--seed", "-1"], "--seed -1"),
    "mix": (["run", "intersection", "--agents", "3", "--mix", "train=1"], "--mix train=1"),
    "fcd name": (["run", "intersection", "--agents", "3", "--steps", "2", "--fcd", "trace.txt"], "trace.txt"),
    "fcd folder": (["run", "intersection", "--agents", "3", "--steps", "2", "--fcd", "no/a.xml"], "no/a.xml"),
    "fcd place": (["run", "intersection", "--agents", "3", "--steps", "2", "--fcd", "/proc/a.xml"], "/proc/a.xml"),
    "summary folder": (["run", "intersection", "--agents", "3", "--steps", "2", "--summary", "no/s.json"], "no/s.json"),
    "summary is a folder": (["run", "intersection", "--agents", "3", "--steps", "2", "--summary", "."], ".: "),
    "report is a file": (
        ["run", "intersection", "--agents", "3", "--steps", "2", "--report", "/dev/null"],
        "/dev/null",
    ),
    "report folder": (
        ["run", "intersection", "--agents", "3", "--steps", "2", "--report", "no/pictures"],
        "no/pictures",
    ),
    "record nan": (["record", "intersection", "--out", "r.npz", "--seconds", "nan"], "--seconds nan"),
    "record inf": (["record", "intersection", "--out", "r.npz", "--seconds", "inf"], "--seconds inf"),
    "record less than nothing": (["record", "intersection", "--out", "r.npz", "--seconds", "-3"], "--seconds -3"),
    "record seed": (["record", "intersection", "--out", "r.npz", "--seconds", "2", "--seed", "-1"], "--seed -1"),
    "record folder": (["record", "intersection", "--out", "no/r.npz", "--seconds", "2"], "no/r.npz"),
    "record as a table": (["record", "intersection", "--out", "r.csv", "--seconds", "2"], "--out r.csv: traj"),
    "record of no road user": (
        ["record", "signalised", "--out", "r.npz", "--seconds", "0.4"],
        "signalised: no road user was there in the first 0.4 s, so nothing is written; give more --seconds",
    ),
    "record nothing": (["record", "nowhere", "--out", "r.npz"], "nowhere: no such file"),
    "fit nothing": (["fit", "none.npz", "--out", "b"], "none.npz"),
    "fit tested on its source": (
        ["fit", "a.npz", "none.npz", "--out", "b", "--test", "./none.npz"],
        "--test none.npz: is learned from as well; errors are measured on other files",
    ),
    "fit in a file": (["fit", "none.npz", "--out", "/dev/null"], ""),
    "family": (["generate", "village", "--out", "g"], "village"),
    "generate in a file": (["generate", "intersection", "--out", "/dev/null"], "/dev/null"),
    "size": (["generate", "random", "--size", "0", "--out", "g"], "0"),
}
"""Command and words of its message."""
CLASHES = {
    "run twice": (
        ["run", "intersection", "--agents", "3", "--fcd", "same.csv", "--summary", "./same.csv"],
        "--fcd same.csv and --summary same.csv would overwrite each other",
    ),
    "run over its scenario": (["run", "CONFIG", "--agents", "3", "--summary", "CONFIG"], "overwrite the input"),
    "run over its network": (
        ["run", "CONFIG", "--agents", "3", "--fcd", "scenario/intersection.rou.xml"],
        "--fcd scenario/intersection.rou.xml would overwrite the input",
    ),
    "run over SUMO's output": (
        ["run", "CONFIG", "--agents", "3", "--fcd", "scenario/own.xml", "--sumo-outputs"],
        "--fcd scenario/own.xml would overwrite the input",
    ),
    "run over SUMO's added output": (
        ["run", "CONFIG", "--agents", "3", "--fcd", "b.xml", "--sumo-options", "--tripinfo-output b.xml"],
        "--fcd b.xml would overwrite the input",
    ),
    "record over its scenario": (["record", "CONFIG", "--out", "CONFIG"], "overwrite the input"),
    "import over its source": (["import", "fcd", "a.npz", "--out", "a.npz"], "overwrite the input a.npz"),
    "fit over its source": (["fit", "bundle/config.json", "--out", "bundle"], "overwrite the input bundle/config.json"),
    "fit report in the bundle": (["fit", "a.npz", "--out", "b", "--report", "b"], "overwrite each other"),
    "train over its bundle": (
        ["train", "CONFIG", "--bundle", "bundle", "--out", "bundle"],
        "--out bundle would overwrite the input bundle/config.json",
    ),
    "evaluate over its recording": (
        ["evaluate", "results.npz", "--bundle", "intersection", "--out", "."],
        "--out . would overwrite the input results.npz",
    ),
    "compare in a file": (["compare", "CONFIG", "--bundle", "bundle", "--out", "a.npz"], "a.npz: is a file"),
    "bench over a scenario": (["bench", "--scenarios", "CONFIG", "--json", "CONFIG"], "overwrite the input"),
    "doctor over its scenario": (["doctor", "CONFIG", "--json", "CONFIG"], "overwrite the input"),
    "generate in a missing folder": (["generate", "intersection", "--out", "no/g"], "no does not exist"),
    "replay over its network": (["replay", "a.npz", "--net", "net.html", "--out", "net.html"], "overwrite the input"),
}
SMOKE = ("guard of lanes", "unknown scenario", "too many", "fcd folder", "family")


def refused(done: subprocess.CompletedProcess[str], words: str, folder: Path) -> None:
    """One clear line, exit code 1, and nothing left behind."""
    assert "Traceback" not in done.stderr
    assert done.returncode == 1, done.stderr
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("slrl-sumo: ")
    assert words in lines[0]
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("what", SMOKE)
def test_wrong_input_gets_one_line_and_exit_code_1(cli_process: Cli, tmp_path: Path, what: str) -> None:
    refused(cli_process(*WRONG[what][0], cwd=tmp_path), WRONG[what][1], tmp_path)


@pytest.mark.parametrize("what", [what for what in WRONG if what not in SMOKE])
def test_all_wrong_input_gets_one_line(cli: Cli, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, what: str) -> None:
    # Refused before SUMO starts: in this process, that saves the imports of the child of each run.
    monkeypatch.setattr(
        "slrl_sumo.api.run.run_isolated", lambda settings, views_at, with_surfaces, traced: run(settings, views_at)
    )
    refused(cli(*WRONG[what][0], cwd=tmp_path), WRONG[what][1], tmp_path)


@pytest.mark.parametrize("what", CLASHES)
def test_no_output_overwrites_an_input_or_another(cli: Cli, copy_scenario: Copy, tmp_path: Path, what: str) -> None:
    config = copy_scenario(
        "intersection", (".sumocfg", "<time>", '<output><fcd-output value="own.xml"/></output><time>')
    )
    for name in ("a.npz", "results.npz", "net.html", "bundle/config.json"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("old")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    words, message = CLASHES[what]
    done = cli(*(str(config) if word == "CONFIG" else word for word in words), cwd=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("slrl-sumo: ")
    assert message in line
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


BROKEN = {
    "missing net": ([(".sumocfg", "intersection.net.xml", "gone.net.xml")], "gone.net.xml"),
    "unknown option": ([(".sumocfg", "<time>", '<output><no-such value="1"/></output><time>')], "no-such"),
    "unknown edge": (
        [(".rou.xml", "<routes>", '<routes><trip id="astray" depart="0" from="nowhere" to="out0"/>')],
        "nowhere",
    ),
    "end that is no time": ([(".sumocfg", '<end value="600"/>', '<end value="noon"/>')], "noon"),
    "mesoscopic": ([(".sumocfg", "<processing>", '<processing><mesosim value="true"/>')], "mesosim"),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", [*BROKEN, "net cut in the middle", "not xml"])
def test_broken_scenarios_get_one_line(cli: Cli, copy_scenario: Copy, tmp_path: Path, what: str) -> None:
    changes, words = BROKEN.get(what, ([], ".net.xml" if what.startswith("net") else "it is no XML text in UTF-8"))
    config = copy_scenario("intersection", *changes)
    if what.startswith("net"):
        net = config.with_name("intersection.net.xml")
        net.write_text(net.read_text()[: net.stat().st_size // 2])
    if what == "not xml":
        config.write_text("begin = 0")
    folder = tmp_path / "cwd"
    folder.mkdir()
    done = cli("run", config, "--agents", 3, "--steps", 2, "--fcd", "a.xml", "--summary", "s.json", cwd=folder)
    refused(done, words, folder)


def test_a_type_without_a_surface_is_refused_only_where_asked_for(cli: Cli, game: Path, tmp_path: Path) -> None:
    config = game / "cross.sumocfg"
    done = cli(
        "run", config, "--agents", 4, "--steps", 2, "--mix", "car=1,pedestrian=1", "--fcd", "a.xml", cwd=tmp_path
    )
    refused(done, "pedestrian", tmp_path)
    done = cli("run", config, "--agents", 4, "--steps", 2, cwd=tmp_path)
    assert done.returncode == 0
    assert done.stderr.startswith("note: no surface for pedestrian")


@pytest.mark.slow
def test_a_trace_that_is_there_survives_a_run_that_is_refused(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text("precious")
    done = cli("run", "intersection", "--agents", 5000, "--fcd", "a.xml", cwd=tmp_path)
    assert done.returncode == 1
    assert (tmp_path / "a.xml").read_text() == "precious"


@pytest.mark.slow
def test_demand_that_breaks_on_the_way_is_exit_code_3_with_what_was_done(
    cli: Cli, copy_scenario: Copy, tmp_path: Path
) -> None:
    from lxml import etree

    config = copy_scenario(
        "intersection",
        (".sumocfg", "<time>", '<input><route-steps value="2"/></input><time>'),
        (
            ".rou.xml",
            "</routes>",
            '<trip id="last" depart="20" from="in0" to="out1"/>'
            '<trip id="astray" depart="40" from="nowhere" to="out0"/></routes>',
        ),
    )
    fcd, summary = tmp_path / "a.xml", tmp_path / "s.json"
    done = cli("run", config, "--agents", 4, "--steps", 150, "--fcd", fcd, "--summary", summary, "--quiet")
    assert done.returncode == 3, done.stderr
    (line,) = done.stderr.splitlines()
    assert "nowhere" in line
    times = [float(step.get("time", "")) for step in etree.parse(str(fcd)).getroot()]
    assert 15 < times[-1] < 45
    assert len(times) == 1 + json.loads(summary.read_text())["decisions"]
