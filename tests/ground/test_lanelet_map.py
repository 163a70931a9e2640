"""Maps in the form of INTERACTION's, levelXdata's, TAF-BW's and Autoware's, each a few lines."""

from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.ground.lanelet_map import ground_of_lanelets
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Surface

TAF_BW = Path(__file__).parents[3] / "shared" / "data" / "taf-bw"

Ways = dict[str, list[tuple[float, float]]]


def written(file: Path, ways: Ways, relations: list[tuple[str, dict[str, list[str]]]], position: str = "xy") -> Path:
    """A map with ways of positions in m, which share nodes at the same places.

    `relations`: type and subtype, "lanelet road", and the ways in each role. `position`: as attributes x and y, or
    `local`, as tags beside degrees elsewhere.
    """
    ids = {place: str(-i) for i, place in enumerate(dict.fromkeys(p for way in ways.values() for p in way), start=1)}
    lines = ["<?xml version='1.0' encoding='UTF-8'?>", "<osm version='0.6'>"]
    for (x, y), name in ids.items():
        if position == "xy":
            lines.append(f"<node id='{name}' visible='true' x='{x}' y='{y}'/>")
        else:
            tags = f"<tag k='local_x' v='{x}'/><tag k='local_y' v='{y}'/>"
            lines.append(f"<node id='{name}' lat='35.6' lon='139.7'>{tags}</node>")
    for name, places in ways.items():
        lines.append(f"<way id='{name}'>" + "".join(f"<nd ref='{ids[place]}'/>" for place in places) + "</way>")
    for i, (kind, roles) in enumerate(relations):
        members = "".join(
            f"<member type='way' ref='{way}' role='{role}'/>" for role, members in roles.items() for way in members
        )
        tags = "".join(f"<tag k='{k}' v='{v}'/>" for k, v in zip(("type", "subtype"), kind.split(), strict=False))
        lines.append(f"<relation id='9{i}'>{members}{tags}</relation>")
    file.write_text("\n".join([*lines, "</osm>"]))
    return file


def street(y: float = 0.0) -> Ways:
    return {
        "south": [(0.0, y), (50.0, y), (100.0, y)],
        "middle": [(0.0, y + 4), (100.0, y + 4)],
        "north": [(0.0, y + 8), (100.0, y + 8)],
    }


def at(ground: RoadMap, *places: tuple[float, float]) -> list[Surface]:
    x, y = np.array(places).T
    return [Surface(value) for value in ground.surface_at(x, y).tolist()]


@pytest.mark.parametrize("position", ["xy", "local"])
def test_lanelets_are_the_ground_between_their_bounds(tmp_path: Path, position: str) -> None:
    lanelets = [
        ("lanelet", {"left": ["middle"], "right": ["south"]}),
        ("lanelet bicycle_lane", {"left": ["north"], "right": ["middle"]}),
    ]
    ground = ground_of_lanelets(written(tmp_path / "map.osm", street(), lanelets, position), None)
    assert ground.bounds == (0.0, 0.0, 100.0, 8.0)
    assert at(ground, (99.0, 1.0), (99.0, 7.0), (99.0, 9.0)) == [Surface.ROAD, Surface.CYCLEWAY, Surface.NONE]


def test_bounds_may_run_either_way_and_consist_of_several_ways(tmp_path: Path) -> None:
    # As in levelXdata's maps: members in any order, each way in its own direction.
    ways = street()
    ways |= {"east": [(100.0, 0.0), (50.0, 0.0)], "west": [(0.0, 0.0), (50.0, 0.0)], "back": ways["middle"][::-1]}
    file = written(tmp_path / "map.osm", ways, [("lanelet road", {"left": ["back"], "right": ["east", "west"]})])
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(0.5, 100.0), np.arange(0.5, 4.0)))
    assert (ground_of_lanelets(file, None).surface_at(x, y) == Surface.ROAD).all()


def test_crossings_lie_on_the_road_and_the_road_on_sidewalks(tmp_path: Path) -> None:
    ways = street() | {
        "one": [(40.0, -2.0), (40.0, 10.0)],
        "other": [(44.0, -2.0), (44.0, 10.0)],
        "kerb": [(0.0, -3.0), (100.0, -3.0)],
        "wall": [(0.0, 2.0), (100.0, 2.0)],
    }
    lanelets = [
        ("lanelet crosswalk", {"left": ["one"], "right": ["other"]}),
        ("lanelet road", {"left": ["north"], "right": ["south"]}),
        ("lanelet walkway", {"left": ["wall"], "right": ["kerb"]}),
    ]
    ground = ground_of_lanelets(written(tmp_path / "map.osm", ways, lanelets), None)
    assert at(ground, (42.0, 4.0), (30.0, 1.0), (30.0, -1.0)) == [Surface.CROSSING, Surface.ROAD, Surface.SIDEWALK]


def test_areas_have_holes_and_some_are_no_ground(tmp_path: Path) -> None:
    ways = street() | {
        "bottom": [(0.0, 20.0), (60.0, 20.0)],
        "rest": [(0.0, 20.0), (0.0, 60.0), (60.0, 60.0), (60.0, 20.0)],
        "tree": [(20.0, 30.0), (40.0, 30.0), (40.0, 50.0), (20.0, 50.0), (20.0, 30.0)],
        "green": [(0.0, 70.0), (60.0, 70.0), (60.0, 90.0), (0.0, 90.0), (0.0, 70.0)],
        "island": [(70.0, 20.0), (80.0, 20.0), (80.0, 30.0), (70.0, 20.0)],
    }
    relations = [
        ("multipolygon parking", {"outer": ["rest", "bottom"], "inner": ["tree"]}),
        ("multipolygon vegetation", {"outer": ["green"]}),
        ("multipolygon traffic_island", {"outer": ["island"]}),
        ("regulatory_element right_of_way", {"ref_line": ["south"]}),
        ("lanelet road", {"left": ["middle"], "right": ["missing"]}),
    ]
    ground = ground_of_lanelets(written(tmp_path / "map.osm", ways, relations), None)
    inside, hole, green, island, street_ = (10.0, 40.0), (30.0, 40.0), (30.0, 80.0), (78.0, 22.0), (50.0, 2.0)
    assert at(ground, inside, hole, green, island, street_) == [
        *(Surface.ROAD, Surface.NONE, Surface.NONE, Surface.SIDEWALK, Surface.NONE)
    ]


def test_what_is_no_such_map_gets_one_line(tmp_path: Path) -> None:
    file = tmp_path / "map.osm"
    with pytest.raises(InputError, match=r"map\.osm: cannot be read \(No such file"):
        ground_of_lanelets(file, None)
    for text, error in (
        ("no map", "it is no XML text"),
        ("<osm><node id='1' lat='49' lon='8'/>", "line 1: it is no well-formed XML"),
        ("<osm><node id='1' lat='x' lon='8'/></osm>", "line 1: could not convert string to float"),
        ("<osm><node id='1' lat='91' lon='8'/></osm>", "a node has no position, or an impossible one"),
        ("<osm><node id='1'/></osm>", "a node has no position"),
        ("<osm><node id='1' lat='49' lon='8.4'/></osm>", r"it lies at 49.0000, 8.4000 degrees; give .* --origin"),
        ("<osm><node id='1' lat='0' lon='0'/></osm>", "there is no lanelet of a road in it"),
        ("<osm/>", "there is no lanelet of a road in it"),
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=f"^--net {file}.*{error}"):
            ground_of_lanelets(file, None)


def test_deleted_lanelets_are_left_out(tmp_path: Path) -> None:
    lanelet = ("lanelet road", {"left": ["middle"], "right": ["south"]})
    file = written(tmp_path / "map.osm", street(), [lanelet])
    file.write_text(file.read_text().replace("<relation", "<relation action='delete'"))
    with pytest.raises(InputError, match="there is no lanelet"):
        ground_of_lanelets(file, None)


@pytest.mark.skipif(not TAF_BW.exists(), reason="needs ../shared/data/taf-bw")
def test_the_cars_of_taf_bw_are_on_the_lanelets_of_its_map() -> None:
    from slrl_sumo.formats.importers.interaction import read_taf_bw

    [tracks] = TAF_BW.glob("recorded_trackfiles/*/vehicle_tracks_000.csv")
    cars = read_taf_bw(tracks)
    ground = ground_of_lanelets(TAF_BW / "maps" / "k733_2018-05-02.osm", "mercator:49.005306,8.4374089")

    def near(shift: float) -> float:
        """Share of positions at most 1 m off the road."""
        return 1.0 - float(ground.beyond_own_surface(cars.type[cars.track], cars.x, cars.y + shift, 1.0).mean())

    assert near(0.0) > 0.99
    # Where the lanes run together a shift does not show.
    assert near(5.0) < 0.95
    assert near(-5.0) < 0.95
