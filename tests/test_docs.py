"""Every command and script of README, tutorials and how-to guides works as written; links, options and names exist."""

import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import sumo

from slrl_sumo.studies.compare.measures import MEASURES
from slrl_sumo.studies.flow.figures import FIGURES

Cli = Callable[..., "subprocess.CompletedProcess[str]"]

ROOT = Path(__file__).parent.parent
DATA = ROOT.parent / "shared" / "data"
"""Recordings that are not part of the project; blocks that need them run where the recordings are available."""
DOCS = {str(file.relative_to(ROOT)): file.read_text(encoding="utf-8") for file in (ROOT / "docs").rglob("*.md")}
PAGES = {name: (ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "CONTRIBUTING.md")} | DOCS
GUIDES = ["README.md", *(name for name in DOCS if name.startswith(("docs/tutorials/", "docs/how-to/")))]
BLOCK = re.compile(r"```(sh|python|toml)\n(.*?)```", re.DOTALL)
CROSS = Path(sumo.SUMO_HOME) / "tools" / "game" / "cross.sumocfg"
OWN = ROOT / "sumo_scenarios" / "intersection" / "intersection.sumocfg"
SCENARIOS = {
    "README.md": CROSS,  # a scenario that this project did not make
    "docs/how-to/attach-to-a-script.md": ROOT / "sumo_scenarios" / "district" / "district.sumocfg",
}
PRINTED = {
    "README.md": r"\d+\.\d+ m/s\n[1-9]\d* of \d+ road users are learned\n"
    r"a bicycle at \d+\.\d m/s earned -?\d+\.\d\d: \{'close': ",
    "docs/how-to/attach-to-a-script.md": r"([6-9]|\d\d+) of \d+ road users are learned\n(.|\n)*"
    r"[1-9]\d* road users are learned, and the ego drives 3\.0 m/s",
    "docs/how-to/use-the-environments.md": r"a bicycle at \d+\.\d m/s earned -?\d+\.\d\d: \{'close': (.|\n)*"
    r"4 road users earned -?\d+\.\d(.|\n)*arrived after \d+ decisions(.|\n)*\(2, 40, 80, 3\)",
    "docs/how-to/report-a-run.md": r"\d+ conflicts with a TTC below 1.5 s, \d+ with a PET below 1 s",
    "docs/how-to/use-from-python.md": r"[1-9]\d* learned cars at 8.0 s\n"
    r"intersection \d+ windows of cars\n\d+ tracks, \d+ positions",
    "docs/how-to/traces.md": r"learned_car(.|\n)* road users, \d+\.\d s at most",
}
"""What the Python scripts of a page print."""
LESS = {"fit": "--epochs 1", "evaluate": "--starts 200"}
"""Options added to the commands for recordings. With the defaults, 35 epochs and a rollout from every fifth frame, they
took 8 of the 34 minutes of all tests, and wrote the same files."""


@pytest.mark.slow
@pytest.mark.parametrize("page", GUIDES)
def test_commands_and_scripts_of_a_guide_run_in_their_order(page: str, tmp_path: Path, cli: Cli) -> None:
    printed = run(page, [block for block in blocks(page) if not needs(block[1])], tmp_path, cli)
    assert re.search(PRINTED.get(page, ""), printed), printed


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hc", "sdd"])
def test_commands_for_recordings_run_where_the_recordings_are(name: str, tmp_path: Path, cli: Cli) -> None:
    page = "docs/tutorials/learn-from-recordings.md"
    ((kind, text),) = (block for block in blocks(page) if needs(block[1]) == name)
    assert [shlex.split(line)[1] for line in text.splitlines()] == ["import", "fit", "evaluate"]
    if not (DATA / name).is_dir():
        pytest.skip(f"{DATA / name} is not there")
    (tmp_path / "out").mkdir()
    short = "".join(f"{line} {LESS.get(shlex.split(line)[1], '')}\n" for line in text.splitlines())
    run(page, [(kind, short)], tmp_path, cli)


def blocks(page: str) -> list[tuple[str, str]]:
    """The code of a page: (sh, python or toml; text)."""
    return BLOCK.findall(PAGES[page])


def needs(code: str) -> str | None:
    """The recordings that a block needs, if any."""
    return next((name for name in ("hc", "sdd") if f"path/to/{name}" in code), None)


def run(page: str, code: list[tuple[str, str]], folder: Path, cli: Cli) -> str:
    """Run blocks one after another in `folder`; returns what the Python ones print.

    A block of TOML is written to the file that its first line names. Each file in out/ that a command names must exist
    in the end. Each line of a guide is a command of its own: slrl-sumo runs inside this process, except on a cluster.
    The README's commands run as a user's shell does.
    """
    if page == "README.md":
        (folder / "out").mkdir()  # `make demo` has made it
    scenario = SCENARIOS.get(page, OWN)
    places = {"path/to/your.sumocfg": scenario, "path/to/your.net.xml": OWN.with_name("intersection.net.xml")}
    places |= {f"path/to/{name}": DATA / name for name in ("hc", "sdd")}
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "SUMO_HOME": sumo.SUMO_HOME,
        "MPLBACKEND": "agg",
        "RAY_USAGE_STATS_ENABLED": "0",
        "SB3_LOGDIR": str(folder),  # else Stable-Baselines3 leaves a folder in the temporary one
    }
    printed = ""
    for kind, text in code:
        for name, place in places.items():
            text = text.replace(name, str(place))
        if kind == "toml":
            (folder / text.split(":")[0].removeprefix("# ")).write_text(text, encoding="utf-8")
        elif kind == "python":
            printed += call([sys.executable, "-c", text], folder, environment)
        elif "ray start" in text:
            with ray_head(text, folder, environment) as rest:
                call(["bash", "-ec", commands(rest)], folder, environment)
        elif page == "README.md":
            call(["bash", "-ec", commands(text)], folder, environment)
        else:
            for line in text.replace("\\\n", " ").splitlines():
                if re.fullmatch(r"slrl-sumo [^|&;<>$*`#]+", line) and "--ray" not in line:
                    done = cli(*shlex.split(line)[1:], cwd=folder)
                    assert done.returncode == 0, f"{line}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
                else:
                    call(["bash", "-ec", commands(line)], folder, environment)
    for name in re.findall(r"\bout/[\w./-]+", "".join(text for kind, text in code if kind == "sh")):
        assert (folder / name).exists(), f"{page}: no command wrote {name}"
    return printed


def commands(text: str) -> str:
    """Shell commands with this interpreter's package in place of the installed script."""
    return re.sub(
        r"^(\.venv/bin/)?slrl-sumo ", f"{shlex.quote(sys.executable)} -m slrl_sumo ", text, flags=re.MULTILINE
    )


def call(command: list[str], folder: Path, environment: dict[str, str]) -> str:
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, f"{command[-1]}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    return done.stdout


@contextmanager
def ray_head(text: str, folder: Path, environment: dict[str, str]) -> Iterator[str]:
    """A Ray head on a free port, in place of the `ray start --head` of `text`; gives the other commands."""
    with socket.create_server(("127.0.0.2", 0)) as free:
        address = f"127.0.0.2:{free.getsockname()[1]}"
    first, *others = text.splitlines()
    host, port = address.split(":")
    short = tempfile.mkdtemp(prefix="ray_", dir="/tmp")  # sockets have short paths
    words = [*shlex.split(first.replace("6379", port)), "--node-ip-address", host, "--temp-dir", short]
    with (folder / "ray.log").open("w+") as log:
        head = subprocess.Popen(
            [*words, "--block", "--include-dashboard=false"],
            env={**environment, "TMPDIR": short},  # what is killed leaves its files there
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
        try:
            deadline = time.monotonic() + 120
            while "Ray runtime started" not in (folder / "ray.log").read_text():
                assert head.poll() is None, (folder / "ray.log").read_text()
                assert time.monotonic() < deadline, (folder / "ray.log").read_text()
                time.sleep(0.1)
            yield "\n".join(others).replace("HEAD:6379", address)
        finally:
            for process in Path("/proc").glob(
                "[0-9]*"
            ):  # Ray's programs are in groups of their own, but of one session
                with suppress(OSError, ProcessLookupError):
                    if (process / "stat").read_text().rpartition(")")[2].split()[3] == str(head.pid):
                        os.kill(int(process.name), signal.SIGKILL)
            head.wait(60)
            shutil.rmtree(short, ignore_errors=True)


def test_only_guides_have_shell_commands_to_copy() -> None:
    """Elsewhere commands are indented: those of measurements belong to their date, those of CONTRIBUTING are make's."""
    assert {page for page in PAGES if re.search(r"```(sh|bash|shell|console)", PAGES[page])} <= set(GUIDES)
    assert {page for page in GUIDES if blocks(page)} == set(GUIDES)


def test_make_targets_of_the_readme_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"^    make (\w+)$", PAGES["README.md"], re.MULTILINE)
    assert targets == ["demo", "test"]
    for target in targets:
        assert re.search(rf"^{target}\b.*:", makefile, re.MULTILINE)


@pytest.mark.parametrize("page", PAGES)
def test_links_of_pages_lead_somewhere(page: str) -> None:
    for target in re.findall(r"\]\(([^):]+)\)", PAGES[page]):
        name, _, anchor = target.partition("#")
        file = (ROOT / page).parent / name if name else ROOT / page
        assert file.exists(), f"{page}: {target}"
        if anchor:
            assert anchor in anchors(file.read_text(encoding="utf-8")), f"{page}: {target}"


def anchors(text: str) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", [page for page in PAGES if not page.startswith("docs/measurements/archive/")])
def test_scripts_that_pages_name_exist(page: str) -> None:
    """What the archive names belongs to the date of the record."""
    for name in re.findall(
        r"(?<![/\w])(?:tools|benchmarks|docs|slrl_sumo|tests|netgen)/[\w./-]+\.(?:py|toml|sh|md)\b", PAGES[page]
    ):
        assert (ROOT / name).is_file(), f"{page}: {name}"


def test_options_that_pages_name_exist() -> None:
    """Commands in prose and indented; those of measurements belong to their date."""
    cli = DOCS["docs/reference/cli.md"]
    known = {part.split("\n")[0]: set(re.findall(r"--[a-z][\w-]*", part)) for part in cli.split("\n## ")[1:]}
    for page, text in PAGES.items():
        if page.startswith("docs/measurements/"):
            continue
        for command, words in re.findall(r"slrl-sumo ([a-z]+)\b([^`\n]*)", text):
            assert command in known, f"{page}: slrl-sumo {command}"
            options = set(re.findall(r"(?<![\w\"-])--[a-z][\w-]*", words))
            assert options <= known[command], f"{page}: slrl-sumo {command} {options - known[command]}"
        named = set(re.findall(r"`(--[a-z][\w-]*)", text)) - FOREIGN
        assert named <= set.union(*known.values()), f"{page}: {named - set.union(*known.values())}"


FOREIGN = {"--time-to-teleport", "--ignore-route-errors", "--fcd-output", "--output-prefix"}
"""Options of other programs that pages name."""


def test_the_site_builds_without_warnings(tmp_path: Path) -> None:
    """Every page is in its navigation, and every link and anchor leads somewhere."""
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")]
    call(command, ROOT, dict(os.environ))
    built = {str(file.relative_to(tmp_path / "site").with_suffix(".md")) for file in tmp_path.rglob("*.html")}
    assert {name.removeprefix("docs/") for name in DOCS} <= built


def test_measurements_are_dated() -> None:
    for page, text in DOCS.items():
        if page.startswith("docs/measurements/") and not page.endswith("index.md"):
            assert re.search(r"^> \*\*Measured\*\* 20\d\d-\d\d-\d\d", text, re.MULTILINE), page


def test_the_table_of_measures_is_complete() -> None:
    table = DOCS["docs/reference/metrics.md"]
    named = {name for line in table.splitlines() if line.startswith("| `") for name in re.findall(r"`(\w+)`", line)}
    assert {measure.name for measure in MEASURES} | set(FIGURES) <= named


def test_the_generated_reference_is_up_to_date(tmp_path: Path) -> None:
    call(
        [sys.executable, str(ROOT / "tools" / "make_reference.py"), str(tmp_path)],
        ROOT,
        {**os.environ, "PYTHONPATH": str(ROOT)},
    )
    for file in tmp_path.iterdir():
        same = file.read_text(encoding="utf-8") == DOCS[f"docs/reference/{file.name}"]
        assert same, f"docs/reference/{file.name} is out of date; run: python tools/make_reference.py"


@pytest.mark.slow
def test_the_example_notebook_runs_and_is_committed_with_its_outputs(tmp_path: Path) -> None:
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "JUPYTER_RUNTIME_DIR": str(tmp_path / "runtime"),
        "IPYTHONDIR": str(tmp_path / "ipython"),
    }
    call([sys.executable, str(ROOT / "tools" / "make_notebook.py"), str(tmp_path / "made.ipynb")], ROOT, environment)
    cells, committed = (
        json.loads(file.read_text(encoding="utf-8"))["cells"]
        for file in (tmp_path / "made.ipynb", ROOT / "docs" / "examples" / "first_look.ipynb")
    )
    assert [cell["source"] for cell in cells] == [cell["source"] for cell in committed]
    for cell, before in zip(cells, committed, strict=True):
        kinds = [sorted(output.get("data", {})) for output in cell.get("outputs", [])]
        assert kinds == [sorted(output.get("data", {})) for output in before.get("outputs", [])]
        assert (
            cell["cell_type"] == "markdown" or kinds == [["text/html", "text/plain"]] or "options" in cell["source"][0]
        )
    text = json.dumps(cells)
    for words in ("taken over", "iframe srcdoc", "too few seeds", "speed_mps"):
        assert words in text
