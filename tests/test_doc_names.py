"""Files, modules and names that docstrings and pages mention exist. Measurement pages keep the names of their date."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import slrl_sumo
from slrl_sumo.learning.rl.training_settings import TrainSettings

ROOT = Path(__file__).parent.parent
CODE = {"slrl_sumo": "slrl_sumo", "netgen": "slrl_sumo.netgen", "benchmarks": "benchmarks", "tools": "tools"}
"""Folders of the repository and the import names of their modules."""
PATH = re.compile(
    r"(?<![\w/.:-])(?:docs|slrl_sumo|tools|benchmarks|tests|netgen|sumo_scenarios)/[\w./-]*\w(?:#[\w-]+)?"
)
MODULE_PATH = re.compile(r"`((?:[a-z_]+/)+[a-z_]+\.py)`")
"""A module in a page, without the folder slrl_sumo."""
DOTTED = re.compile(r"(?<![\w/.\-])[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+(?![\w/(-]*/)")
FILE = re.compile(
    r"\.(?:py|md|json|jsonl|csv|toml|xml|npz|png|html|safetensors|sh|pt|parquet|sumocfg|net|yaml|osm|gz|ipynb)$"
)
ENVIRONMENT = re.compile(r"slrl_sumo/[A-Z]\w+-v\d")
PLACEHOLDER = re.compile(r"[A-Z]{3,}\.toml|_$")
"""A part of a name that stands for several files, as tools/selectors/NAME.toml."""
EXTERNAL = {"sumo.SUMO_HOME", "env.sumo"}
"""Names of SUMO's wheel and of sumo-rl."""
SUMO_CALL = re.compile(r"\.(?:get|set|change)[A-Z]\w*$|\.(?:moveToXY|simulationStep)$")
"""A function of SUMO's API: its domains `simulation` and `lane` have names of our folders."""


def modules() -> dict[str, Path]:
    """Import names of all modules of the repository, and their files."""
    found = {}
    for folder, name in CODE.items():
        for file in sorted((ROOT / folder).rglob("*.py")):
            parts = file.relative_to(ROOT / folder).with_suffix("").parts
            found[".".join((name, *(part for part in parts if part != "__init__")))] = file
    return found


MODULES = modules()
PAGES = {
    str(file.relative_to(ROOT)): file.read_text(encoding="utf-8")
    for file in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
    if "measurements" not in file.parts
}
STEMS = {stem: [name for name in MODULES if name.endswith(f".{stem}")] for stem in {n.split(".")[-1] for n in MODULES}}
FOLDERS = {name.split(".")[1] for name in MODULES if name.startswith("slrl_sumo.")}


@cache
def tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


@cache
def members(file: Path) -> frozenset[str]:
    """Names at the top of a module."""
    found: set[str] = set()
    for node in tree(file).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Assign):
            found |= {one.id for target in node.targets for one in ast.walk(target) if isinstance(one, ast.Name)}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found.add(node.target.id)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            found |= {(one.asname or one.name).split(".")[0] for one in node.names}
    return frozenset(found)


@cache
def classes() -> dict[str, set[str]]:
    """Names that the classes of the repository define, by class; classes of one name together, with their bases'."""
    found: dict[str, set[str]] = {}
    bases: dict[str, set[str]] = {}
    for file in MODULES.values():
        for node in ast.walk(tree(file)):
            if isinstance(node, ast.ClassDef):
                own = found.setdefault(node.name, set())
                bases.setdefault(node.name, set()).update(one.id for one in node.bases if isinstance(one, ast.Name))
                for one in ast.walk(node):
                    if isinstance(one, ast.FunctionDef):
                        own.add(one.name)
                    elif isinstance(one, ast.Name | ast.Attribute) and isinstance(one.ctx, ast.Store):
                        own.add(one.id if isinstance(one, ast.Name) else one.attr)
    for name, names in bases.items():
        for base in names & found.keys():
            found[name] |= found[base]
    return found


@cache
def functions() -> frozenset[str]:
    """Functions and classes of all modules."""
    kinds = ast.FunctionDef | ast.ClassDef
    return frozenset(node.name for file in MODULES.values() for node in tree(file).body if isinstance(node, kinds))


def exists(name: str) -> bool:
    """Whether a full dotted name is a module, a folder, or in a module."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        module = ".".join(parts[:k])
        if module in MODULES:
            if k == len(parts) or parts[k] in members(MODULES[module]):
                return True
            return k == 1 and hasattr(slrl_sumo, parts[1])
    return False


def missing(name: str, known: set[str]) -> bool:
    """Whether a dotted name is of this repository and not in it; `known`: names that its text defines."""
    first, rest = name.split(".", 1)
    if first in ("slrl_sumo", "benchmarks", "tools"):
        return not (exists(name) or (ROOT / name.replace(".", "/")).exists())
    if first in classes():
        return rest.split(".")[0] not in classes()[first]
    if rest in classes().get("".join(part.title() for part in first.split("_")), ()):
        return False  # an instance with the name of its class
    if first in known or exists(f"slrl_sumo.{name}") or any(exists(f"{one}.{rest}") for one in STEMS.get(first, [])):
        return False
    return first in FOLDERS or first in STEMS or rest in functions()


def identifiers(file: Path) -> set[str]:
    """All names in the code of a module."""
    found: set[str] = set()
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.Name):
            found.add(node.id)
        elif isinstance(node, ast.arg):
            found.add(node.arg)
        elif isinstance(node, ast.Attribute):
            found.add(node.attr)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            found |= {one.asname or one.name for one in node.names}
    return found


def defined(text: str) -> set[str]:
    """Names that the examples of a text define."""
    return set(re.findall(r"(?:\bas|\bfor|\bimport) (\w+)\b", text)) | set(re.findall(r"\b(\w+) = ", text))


def docstrings(file: Path) -> list[str]:
    """Docstrings of a module, its classes, functions and constants, without addresses."""
    nodes = (node.value for node in ast.walk(tree(file)) if isinstance(node, ast.Expr))
    texts = (node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str))
    return [re.sub(r"https?://\S+", "", text) for text in texts]


def anchors(text: str) -> set[str]:
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def lost_paths(text: str) -> list[str]:
    """Files of the repository that a text names and that are not there."""
    lost = []
    for name in PATH.findall(text):
        path, _, anchor = name.partition("#")
        if ENVIRONMENT.fullmatch(path) or PLACEHOLDER.search(path):
            continue
        file = ROOT / path
        if not file.exists() or (anchor and anchor not in anchors(file.read_text(encoding="utf-8"))):
            lost.append(name)
    return lost


@pytest.mark.parametrize("folder", CODE)
def test_files_that_code_mentions_exist(folder: str) -> None:
    for file in (ROOT / folder).rglob("*"):
        if file.suffix in (".py", ".toml", ".md", ".sh") and "machine_code" not in file.parts:
            text = re.sub(r"https?://\S+", "", file.read_text(encoding="utf-8"))
            assert not lost_paths(text), f"{file.relative_to(ROOT)}: {lost_paths(text)}"


@pytest.mark.parametrize("page", PAGES)
def test_files_that_pages_mention_exist(page: str) -> None:
    text = re.sub(r"https?://\S+", "", PAGES[page])
    assert not lost_paths(text)
    for name in MODULE_PATH.findall(text):
        assert any((place / name).is_file() for place in (ROOT, ROOT / "slrl_sumo")), name


@pytest.mark.parametrize("folder", CODE)
def test_names_in_docstrings_exist(folder: str) -> None:
    for file in (ROOT / folder).rglob("*.py"):
        known = identifiers(file)
        for text in docstrings(file):
            lost = [name for name in dotted(text) if missing(name, known | defined(text))]
            assert not lost, f"{file.relative_to(ROOT)}: {lost}"


@pytest.mark.parametrize("page", [page for page in PAGES if not page.endswith("api.md")])
def test_names_in_pages_exist(page: str) -> None:
    """The API reference is made of docstrings."""
    prose = re.sub(r"```.*?```", "", PAGES[page], flags=re.DOTALL)
    names = [name for code in re.findall(r"`([^`\n]+)`", prose) for name in dotted(code)]
    lost = [name for name in names if not is_setting(name) and missing(name, examples())]
    assert not lost, lost


@cache
def examples() -> set[str]:
    """Names that the code of pages defines."""
    code = (block for page in PAGES.values() for block in re.findall(r"```.*?```", page, re.DOTALL))
    return set().union(*map(defined, code))


def dotted(text: str) -> list[str]:
    """The dotted names of a text that are neither files nor SUMO's."""
    names = DOTTED.findall(text)
    return [one for one in names if not FILE.search(one) and not SUMO_CALL.search(one) and one not in EXTERNAL]


def is_setting(name: str) -> bool:
    """Whether a name is a key of the settings of a training, as `ppo.gamma`."""
    section, key = name.split(".", 1)
    return hasattr(getattr(TrainSettings(), section, None), key)


def test_names_that_are_not_there_are_found() -> None:
    assert lost_paths("see docs/prediction.md and slrl_sumo/agent/decide.py") == ["docs/prediction.md"]
    assert lost_paths("docs/architecture.md#no-such-heading, docs/architecture.md#the-tree") == [
        "docs/architecture.md#no-such-heading"
    ]
    assert missing("surrogate.time_to_collision", {"box"})
    assert not missing("surrogate_safety.time_to_collision", set())
    assert missing("slrl_sumo.agent.patience", set())
    assert not missing("slrl_sumo.parallel_env", set())
    assert missing("WorldState.no_such_field", set())
    assert not missing("WorldState.speed", set())


def test_modules_of_the_architecture_hold_what_it_says() -> None:
    """Each row of its table of one decision names a module, and functions or classes in it."""
    rows = re.findall(r"^\| \d+ \| `([\w/]+\.py)` \| (.*) \|$", PAGES["docs/architecture.md"], re.MULTILINE)
    assert len(rows) == 12
    for module, step in rows:
        held = members(ROOT / "slrl_sumo" / module)
        first = re.match(r"`(\w+)", step)
        assert first is None or first[1] in held, f"{module}: {step}"
