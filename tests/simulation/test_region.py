"""Regions of takeover, in a real network."""

from collections.abc import Iterator

import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.simulation.region import JUNCTION_RADIUS, Region, parse_region
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


@pytest.fixture(scope="module")
def session() -> Iterator[SumoSession]:
    with SumoSession(find_scenario("intersection")) as session:
        yield session


def _parse(text: str | None, session: SumoSession) -> Region:

    return parse_region(text, session.network)


def _inside(region: Region, x: float, y: float, margin: float = 0.0) -> bool:
    return bool(region.inside(np.array([x]), np.array([y]), margin)[0])


def test_no_region_is_everywhere(session: SumoSession) -> None:
    assert _inside(_parse(None, session), 1e6, -1e6)


def test_junction_is_a_disc_round_its_centre_with_hysteresis(session: SumoSession) -> None:
    import libsumo

    x, y = libsumo.junction.getPosition("centre")
    region = _parse("junction:centre,radius=80", session)
    assert region.inside(np.array([x, x + 79.9, x, x + 80.1]), np.array([y, y, y - 79.9, y])).tolist() == [
        True,
        True,
        True,
        False,
    ]
    # Between the two rims: from outside it is not yet in, from inside not yet out.
    assert not _inside(region, x + 83.0, y)
    assert _inside(region, x + 83.0, y, margin=5.0)
    assert not _inside(region, x + 85.1, y, margin=5.0)


def test_junction_without_radius_has_the_usual_one(session: SumoSession) -> None:
    import libsumo

    x, y = libsumo.junction.getPosition("centre")
    region = _parse("junction:centre", session)
    assert _inside(region, x + JUNCTION_RADIUS - 0.1, y)
    assert not _inside(region, x + JUNCTION_RADIUS + 0.1, y)


def test_box_takes_its_corners_in_any_order_and_has_hysteresis(session: SumoSession) -> None:
    for text in ("box:10,20,-5,0", "box:-5,0,10,20"):
        region = _parse(text, session)
        x, y = np.array([-5.0, 10.0, 2.0, -5.1, 2.0]), np.array([0.0, 20.0, 10.0, 10.0, 20.1])
        assert region.inside(x, y).tolist() == [True, True, True, False, False]
        assert region.inside(x, y, margin=0.2).all()


def test_edges_are_the_surface_of_their_lanes(session: SumoSession) -> None:
    lanes = [lane for lane in session.network.lanes if lane.edge == "in0"]
    region = _parse("edges:in0,out1", session)
    for lane in lanes:
        along = lane.shape[-1] - lane.shape[0]
        along = along / np.hypot(*along)
        middle = lane.shape.mean(axis=0)
        left = np.array([-along[1], along[0]])
        for across in (-0.45, 0.0, 0.45):
            assert _inside(region, *(middle + across * lane.width * left))
        before = lane.shape[0] - 3.0 * along
        assert not _inside(region, before[0], before[1])
        assert _inside(region, before[0], before[1], margin=5.0)
    elsewhere = next(lane for lane in session.network.lanes if lane.edge == "in2")
    far = elsewhere.shape.mean(axis=0)
    assert not _inside(region, far[0], far[1], margin=5.0)
    other = next(lane for lane in session.network.lanes if lane.edge == "out1")
    assert _inside(region, *other.shape.mean(axis=0))


def test_unknown_ids_are_refused_and_the_nearest_named(session: SumoSession) -> None:
    with pytest.raises(InputError, match=r"no junction 'center'; is it centre\?"):
        _parse("junction:center,radius=80", session)
    with pytest.raises(InputError, match=r"no edge 'in9'; is it in\d or in\d or in\d\?"):
        _parse("edges:in0,in9", session)
    with pytest.raises(InputError, match=r"no junction 'xyz'; there are .*centre"):
        _parse("junction:xyz", session)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "centre",
        "junction:",
        "junction:centre,radius=far",
        "junction:centre,radius=0",
        "junction:centre,radius=inf",
        "box:1,2,3",
        "box:1,2,3,x",
        "box:1,2,1,5",
        "edges:",
        "circle:0,0,5",
    ],
)
def test_malformed_regions_are_refused(text: str, session: SumoSession) -> None:
    with pytest.raises(InputError, match=f"^region='{text}': ") as refusal:
        _parse(text, session)
    assert refusal.value.as_options().startswith(f"--region {text}".rstrip() + ": ")


def test_a_signal_names_all_its_junctions() -> None:
    places = {"a": (0.0, 0.0), "b": (100.0, 0.0), "c": (200.0, 0.0)}
    network = Network((), (), junction_positions=places, signal_junctions={"joined": ("a", "b")})
    region = parse_region("junction:joined,radius=20", network)
    assert region.inside(np.array([0.0, 50.0, 110.0, 200.0]), np.zeros(4)).tolist() == [True, False, True, False]
    with pytest.raises(InputError, match=r"no junction 'joint'; is it joined\?"):
        parse_region("junction:joint", network)
