"""Metres from degrees, compared with netconvert's (PROJ) and with figures of published recordings."""

import math
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from slrl_sumo.errors import InputError
from slrl_sumo.ground.projection import Origin, parse_origin, project
from slrl_sumo.netgen.binaries import run_program


def utm_of_netconvert(folder: Path, places: list[tuple[float, float]]) -> np.ndarray:
    """Easting and northing of the two ends of a street, (2, 2), to 1 cm."""
    nodes = "".join(f'<node id="{i}" lat="{lat!r}" lon="{lon!r}" version="1"/>' for i, (lat, lon) in enumerate(places))
    way = '<way id="5" version="1"><nd ref="0"/><nd ref="1"/><tag k="highway" v="residential"/></way>'
    (folder / "street.osm").write_text(f'<osm version="0.6">{nodes}{way}</osm>')
    options = [
        "--proj.utm",
        "--offset.disable-normalization",
        "--plain-output-prefix",
        "street",
        "-o",
        "street.net.xml",
    ]
    run_program("netconvert", ["--osm-files", "street.osm", *options], folder)
    found = {node.get("id"): node for node in etree.parse(str(folder / "street.nod.xml")).getroot().iter("node")}
    return np.array([[float(found[end].get("x")), float(found[end].get("y"))] for end in "01"])


@pytest.mark.parametrize(
    "places",
    [
        [(49.0053, 8.4374), (49.0069, 8.4401)],
        [(50.7785, 6.0001), (50.7799, 6.0002)],  # at the border of a zone
        [(0.0009, 0.0009), (0.0018, 0.0001)],
    ],
)
def test_utm_is_that_of_netconvert(places: list[tuple[float, float]], tmp_path: Path) -> None:
    expected = utm_of_netconvert(tmp_path, places)
    latitude, longitude = np.array(places).T
    east, north = expected[0]
    in_metres = project(latitude, longitude, Origin("utm", north, east, metric=True))
    np.testing.assert_allclose(np.stack(in_metres, 1), expected - expected[0], atol=0.011)
    in_degrees = project(latitude, longitude, Origin("utm", *places[0]))
    np.testing.assert_allclose(np.stack(in_degrees, 1), expected - expected[0], atol=0.011)


def test_south_of_the_equator_northings_count_from_ten_thousand_kilometres() -> None:
    x, y = project(np.array([-0.0009]), np.array([0.0009]), Origin("utm", 1e7, 166_021.44, metric=True))
    x0, y0 = project(np.array([0.0009]), np.array([0.0009]), Origin("utm", 0.0, 166_021.44, metric=True))
    np.testing.assert_allclose([x[0], y[0]], [x0[0], -y0[0]], atol=1e-6)


def test_interaction_places_its_maps_in_metres_from_0_0() -> None:
    # The test scenario of its scripts: a road of 100 m with two lanes of 3 m, whose first corner is (1, 1) m.
    latitude, longitude = np.array([9.03483e-6, 6.324382e-5]), np.array([8.97435e-6, 9.0640957e-4])
    x, y = project(latitude, longitude, parse_origin("utm:0,0"))
    np.testing.assert_allclose(x, [1.0, 101.0], atol=0.001)
    np.testing.assert_allclose(y, [1.0, 7.0], atol=0.001)


def test_mercator_is_true_to_scale_at_its_origin() -> None:
    x, y = project(np.array([49.0063]), np.array([8.4384]), parse_origin("mercator:49.0053,8.4374"))
    metre = 6_378_137.0 * math.pi / 180  # of a degree on the sphere
    assert x[0] == pytest.approx(0.001 * metre * math.cos(math.radians(49.0053)), abs=1e-6)
    assert y[0] == pytest.approx(0.001 * metre, rel=2e-5)


@pytest.mark.parametrize("text", ["", "utm", "utm:1", "utm:a,b", "mercator:99,0", "mercator:293487,5629712", "wgs:1,2"])
def test_other_origins_get_one_line(text: str) -> None:
    with pytest.raises(InputError, match=r"^--origin .*: give the place of \(0, 0\) m"):
        parse_origin(text)
