import subprocess
from pathlib import Path

import pytest
import sumo

HOME = Path(sumo.SUMO_HOME)


@pytest.fixture(scope="session")
def cross_fcd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """SUMO's own FCD of 20 s of its game scenario `cross`, as .xml; .xml.gz, .csv and .parquet lie beside it."""
    folder = tmp_path_factory.mktemp("cross")
    for suffix in (".xml", ".xml.gz", ".csv", ".parquet"):
        command = [HOME / "bin" / "sumo", "-c", HOME / "tools" / "game" / "cross.sumocfg", "--end", "20"]
        command += ["--step-length", "0.4", "--precision", "6", "--fcd-output", folder / f"cross{suffix}"]
        subprocess.run(command, check=True, capture_output=True, timeout=60)
    return folder / "cross.xml"
