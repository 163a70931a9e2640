"""Vaporizers and arrival positions are found in the files that SUMO has read."""

from pathlib import Path

import pytest

from slrl_sumo.sumo.scenario.loaded_files import (
    SEARCHED_BYTES,
    arrival_positions,
    edges_of_access,
    overtaking_lanes,
    vaporized_edges,
)


def test_vaporizers_are_found_at_any_depth_and_in_included_files(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "b.xml").write_text('<additional><include href="c.xml"/><vaporizer id="e2"/></additional>')
    (tmp_path / "inner" / "c.xml").write_text('<additional><foo><vaporizer id="e3"/></foo></additional>')
    (tmp_path / "a.xml").write_text(
        '<additional><!-- <vaporizer id="e0"/> --><vaporizer id="e1"/><include href="inner/b.xml"/></additional>'
    )
    assert vaporized_edges(f"{tmp_path / 'a.xml'}", "") == {"e1", "e2", "e3"}
    assert vaporized_edges("", "") == frozenset()


def test_files_that_cannot_be_read_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text('<additional><vaporizer id="e1"/></additional>')
    (tmp_path / "b.xml").write_text("no XML")
    config = tmp_path / "x.sumocfg"
    assert vaporized_edges(",".join(f"{tmp_path}/{name}" for name in ("b.xml", "none", "a.xml")), f"{config}") == {"e1"}


def test_paths_are_those_of_the_configuration_and_of_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FOLDER", str(tmp_path / "d"))
    for name in ("c", "d"):
        (tmp_path / name).mkdir()
    for number, name in enumerate(("c/a.xml", "d/b.xml", "e.xml")):
        (tmp_path / name).write_text(f'<additional><vaporizer id="{number}"/></additional>')
    # As getOption of libsumo 1.28 gives them for "a.xml, ${FOLDER}/b.xml" in c/x.sumocfg.
    assert vaporized_edges("c/a.xml,c/ ${FOLDER}/b.xml", "c/x.sumocfg") == {"0", "1"}
    assert vaporized_edges("e.xml, c/a.xml", "c/x.sumocfg") == {"2", "0"}
    assert vaporized_edges("a.xml", "c/x.sumocfg") == frozenset()


def test_the_edges_from_which_stops_have_an_access_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(
        '<additional><busStop id="s" lane="x_1"><access lane="x_0" pos="3"/><access lane=":j_w0_0" pos="1"/></busStop>'
        '<busStop id="t" lane="x_1"/><trainStop id="u" lane="r_0"><access lane="a_b_2" pos="0"/></trainStop>'
        "</additional>"
    )
    found = edges_of_access(str(tmp_path / "a.xml"), "")
    assert found == {"s": {"x", ":j_w0"}, "u": {"a_b"}}


def test_lanes_with_an_opposite_one_are_found_outside_junctions(tmp_path: Path) -> None:
    lanes = '<lane id="{0}_0"/><lane id="{0}_1"><neigh lane="b_1"/></lane>'
    (tmp_path / "n.net.xml").write_text(
        f'<net><edge id=":j">{lanes.format(":j")}</edge><edge id="a">{lanes.format("a")}</edge></net>'
    )
    assert overtaking_lanes(str(tmp_path / "n.net.xml")) == ("a_1",)


def test_arrival_positions_are_those_of_vehicles_trips_and_flows(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(
        '<routes><vehicle id="v" arrivalPos="40"><route edges="a b"/></vehicle><trip id="t" arrivalPos="-5.5"/>'
        '<flow id="f" arrivalPos="random"/><flow id="g" arrivalPos="max"/><trip id="u"/>'
        '<person id="p"><walk edges="a" arrivalPos="3"/></person></routes>'
    )
    (tmp_path / "b.xml").write_text(f'<routes>{" " * (SEARCHED_BYTES - 15)}<flow id="h" arrivalPos="7"/></routes>')
    (tmp_path / "c.xml").write_text('<additional><include href="b.xml"/></additional>')
    assert arrival_positions("", str(tmp_path / "a.xml"), "") == {"v": 40.0, "t": -5.5}
    assert arrival_positions(str(tmp_path / "c.xml"), "", "") == {"h": 7.0}
